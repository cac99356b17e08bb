"""Thin tasks: claim, load, call a pure package, write and finish."""
