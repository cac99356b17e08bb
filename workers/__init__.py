"""What reads recordings, finds vertices and solves; it never speaks HTTP."""
