"""Summaries of a dataset for ``elvis info`` and for a prompt."""
