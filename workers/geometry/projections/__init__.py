"""The camera models as mathematics: one file each, and the table of all."""
