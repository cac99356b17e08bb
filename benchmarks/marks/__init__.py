"""How good the machine's marks are: on rendered scenes, on scenes without a board, on real recordings."""
