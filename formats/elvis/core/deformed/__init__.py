"""Deformed, copied and separated geometry."""
