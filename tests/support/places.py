"""Where the project's root, its pages and the recordings of real sensors lie."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
FRONTEND = ROOT / "frontend"
# Beside the project; tests that need them are skipped without.
DATA = ROOT.parent / "shared" / "data"
BOARD = DATA / "vlp16-diamond-board"
