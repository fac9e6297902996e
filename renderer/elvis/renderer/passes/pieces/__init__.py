"""Drawing of line pieces in tiles, for tubes and ribbons."""
