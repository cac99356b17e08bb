"""Folders and archives: whatever sources they hold, as one recording."""
