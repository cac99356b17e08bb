"""Jobs as the outside sees them."""
