"""Server-sent hints."""
