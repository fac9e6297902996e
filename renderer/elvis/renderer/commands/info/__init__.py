"""``elvis info``: the contents of data, and what is asked about them."""
