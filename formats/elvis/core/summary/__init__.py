"""What ``elvis info`` and a prompt say of a dataset."""
