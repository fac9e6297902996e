"""What is to be said of a dataset: proved Jacobians, and the rules that files must keep."""
