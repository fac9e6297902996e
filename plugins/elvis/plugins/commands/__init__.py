"""What commands have in common: arguments, and how they become data."""
