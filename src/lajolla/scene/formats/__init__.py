"""Files that scenes name: pictures, volumes, curves, tensors, material libraries."""
