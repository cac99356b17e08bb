"""Thin tasks: claim, load, call a pure room, write and finish."""
