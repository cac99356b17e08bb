"""The fault campaign: work under way while everything that can fail does, and then every promise looked at."""
