"""Nodes of old files in the words and with the defaults of today."""
