"""A LiDAR, a camera and a walker with a board; writes real file formats."""
