"""Sample data whose truth is known."""
