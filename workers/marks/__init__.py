"""Marks by the machine: the pixels of the board's corners in the frames of one camera, without a nominal mount."""
