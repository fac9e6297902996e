"""Streamlines as ribbons: strips that turn with the flow, met by each pixel's ray."""
