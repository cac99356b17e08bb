"""Workers read recordings, find vertices and solve. They never speak HTTP."""
