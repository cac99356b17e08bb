"""Kills processes on purpose, on both databases, and looks whether everything ends once and with the same bits."""
