"""Other optimisers on the same fit, one short file per family; nothing else imports their libraries."""
