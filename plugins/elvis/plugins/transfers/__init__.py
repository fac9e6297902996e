"""Fields on another mesh, or another space, by L2 projections with measured errors."""
