"""Means along directions and over steps, as datasets of their own."""
