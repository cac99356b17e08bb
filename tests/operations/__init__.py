"""What an operator does to a running fleet, with real processes."""
