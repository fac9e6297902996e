"""The commands of this area, one a module; each imports what is heavy inside its functions."""
