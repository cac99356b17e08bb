"""A fleet request of a thousand vehicles through the real service, beside the bare solver."""
