"""Answers to an operator's monitoring: whether the service lives, whether it can work, and its figures."""
