"""The commands of this area, one per module; each imports heavy modules inside its functions."""
