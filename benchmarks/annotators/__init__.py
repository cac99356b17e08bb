"""Many annotators on one recording."""
