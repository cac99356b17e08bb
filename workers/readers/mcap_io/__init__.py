"""MCAP files, record by record: what readers, copies and writers share."""
