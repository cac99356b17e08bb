"""Encoded images, raw pixels and videos, as frames that a browser shows."""
