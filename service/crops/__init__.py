"""Pages of crops, on which people confirm the machine's marks."""
