"""What knows no finite element: arrays, errors, memory, texts, ranks, messages.

May be imported by everything.
"""
