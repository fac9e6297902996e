"""The accuracy report: a folder that shows the errors that linear visualization makes with a user's own data."""
