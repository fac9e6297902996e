"""Conversion plugins: their interface (``plugin``), discovery, execution, checks, reports and cache."""
