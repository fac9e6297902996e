"""Streamlines as tubes: the balls about polynomial curves, met by each pixel's ray."""
