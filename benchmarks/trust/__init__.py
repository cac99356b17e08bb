"""Whether a report's verdict names what is wrong, and leaves sound results alone."""
