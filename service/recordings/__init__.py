"""Uploads and recordings."""
