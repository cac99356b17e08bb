"""Questions about a recording: region previews, region suggestions, the offset between clocks."""
