"""Each headline figure as one command, its peers beside us in the same run; the last line is JSON."""
