"""Moving pictures: frames one after another, and the files that hold them."""
