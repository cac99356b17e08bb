"""Real recordings with a board, each calibrated by `apexcal solve` as a stranger would."""
