"""MCAP files, record by record: what readers and copies share."""
