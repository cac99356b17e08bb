"""Writes what the simulator made as a recorder would have: one module per family of formats."""
