"""Pictures of whole scenes by other means than the renderer's: tessellations propose, Newton's method decides."""
