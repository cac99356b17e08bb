"""Fleets, vehicles and rigs."""
