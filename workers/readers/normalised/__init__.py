"""The recording as everything downstream reads it: one file per sensor, and a manifest."""
