"""The recording as everything downstream reads it: one MCAP file per sensor, and a manifest."""
