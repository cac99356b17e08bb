"""Marks, verdicts and the tasks that lead to them."""
