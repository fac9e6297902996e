"""What a picture is asked for: requests, the data that they mean, and what is completed from the data.

Everything that draws may import it; it imports no pass.
"""
