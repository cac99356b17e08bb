"""What an operator's monitoring asks: whether the service lives, whether it can work, and its figures."""
