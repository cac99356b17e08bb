"""Correspondence sets: immutable 3D-2D pairs, made of marks or imported."""
