"""The ``elvis`` command: built from the commands that entry points name, run with its messages and interrupts."""
