"""Pictures from within a running solver."""
