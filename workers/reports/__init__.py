"""The report of a result: its numbers, its plots, and the page that holds both."""
