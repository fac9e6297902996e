"""What passes share that draw pieces of elements in tiles."""
