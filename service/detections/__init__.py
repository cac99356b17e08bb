"""Detection runs, their regions and vertices."""
