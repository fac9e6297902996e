"""Points, sides and sizes of elements, where quantities are evaluated."""
