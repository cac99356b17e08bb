"""How well the offset between camera and LiDAR clock is found from a walk."""
