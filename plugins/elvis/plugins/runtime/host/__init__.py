"""Data of runtime plugins evaluated on the host."""
