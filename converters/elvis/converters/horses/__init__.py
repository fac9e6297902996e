"""Files of HORSES3D."""
