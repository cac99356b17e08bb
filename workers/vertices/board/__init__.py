"""The ``refined`` detector: the apex from what the board is, a plane with a right-angled corner."""
