"""Foundations without finite elements: arrays, errors, memory, texts, ranks, messages.

Every slice may import it; it imports no other folder.
"""
