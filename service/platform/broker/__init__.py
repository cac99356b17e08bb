"""Hints for browsers over the broker, and the waiting of connections to it."""
