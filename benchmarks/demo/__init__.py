"""The main job from end to end, driven over HTTP as a client would: ``python -m benchmarks.demo``."""
