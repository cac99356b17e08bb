"""Packets of Velodyne sensors."""
