"""What the commands that draw have in common: options, and scenes made of them."""
