"""Common parts of the commands that draw: options, and scenes built from them."""
