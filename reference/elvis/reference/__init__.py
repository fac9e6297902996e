"""The reference: the same images by other means, in float64, and reports of how far apart they are."""
