"""Analyses: what is asked of a recording, of pairs or of a result, and answered by one job."""
