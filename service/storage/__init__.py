"""Blobs behind obstore."""
