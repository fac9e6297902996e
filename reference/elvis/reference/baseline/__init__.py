"""What linear visualization would show: elements cut into simplices, everything on them interpolated linearly."""
