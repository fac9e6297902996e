"""What a picture records at each pixel, and the colours made of it."""
