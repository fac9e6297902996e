"""A picture with its bars, rulers and texts, and the files that hold it."""
