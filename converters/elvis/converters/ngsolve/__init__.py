"""Meshes and functions of NGSolve and Netgen."""
