"""The HTTP client and, built on it, the `apexcal` command."""
