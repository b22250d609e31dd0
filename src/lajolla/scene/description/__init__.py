"""Nodes to the description that the core takes."""
