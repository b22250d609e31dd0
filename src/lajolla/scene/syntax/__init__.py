"""Scene text and scene dicts to nodes: what stands in a file, and where."""
