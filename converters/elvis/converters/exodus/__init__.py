"""Exodus files, alone and in pieces."""
