"""Packets of Ouster sensors."""
