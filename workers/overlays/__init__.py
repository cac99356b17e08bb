"""A sweep in its camera frame: which points the camera sees at the frame's time, drawn by their distance."""
