"""A picture with what stands around it: bars, rulers, texts, files.

It may import the model and records.
"""
