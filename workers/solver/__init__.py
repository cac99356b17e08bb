"""One GA slot, the narrowing schedule, polish, baselines, folds."""
