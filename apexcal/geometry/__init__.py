"""Rotations and rigid transforms that service and workers share. They need NumPy, which the client never loads."""
