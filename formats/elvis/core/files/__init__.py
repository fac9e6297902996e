"""Files: what may be opened, what is written whole or not at all, and the plain formats that tables and grids go to."""
