"""The accuracy report: one folder that tells what linear visualization would have shown of a user's own data."""
