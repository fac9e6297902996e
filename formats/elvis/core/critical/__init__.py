"""All zeros of a velocity, and of the shear on a wall."""
