"""Rotations, rigid transforms and camera models."""
