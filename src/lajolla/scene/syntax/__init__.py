"""Scene files and dicts to nodes, with locations."""
