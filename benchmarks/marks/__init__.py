"""How good the machine's marks are: on rendered scenes, on scenes without a board, on real recordings; and what
becomes of a walk that is calibrated from them."""
