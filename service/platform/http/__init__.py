"""What all routes share: problems, pages, entity tags, idempotency and sessions."""
