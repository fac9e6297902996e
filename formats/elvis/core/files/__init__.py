"""Files: plain files, output that is complete or absent, and the plain formats of tables and grids."""
