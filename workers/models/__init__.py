"""The models of a camera compared: evidence of held-out pairs, choice, spread, and the summary."""
