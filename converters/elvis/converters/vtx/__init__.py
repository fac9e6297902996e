"""DOLFINx's VTX files."""
