"""Tiles of the machine's marks."""

import numpy as np

from apexcal.documents.machine_marks import TILE_COLUMNS
from workers.tasks.crop_tiles import write_tiles


def test_a_mark_far_outside_of_its_frame_has_no_tile(tmp_path):
    rows = [
        {"vertex_id": str(k), "u": 50.0, "v": v, "sigma_u": 0.5, "sigma_v": 0.5, "edge_px": 64.0, "reason": None}
        for k, v in enumerate((40.0, -467.0))
    ]
    file = tmp_path / "crops.png"
    write_tiles(rows, {"0": 3, "1": 3}, [(3, np.zeros((80, 100, 3), np.uint8))], file)
    assert rows[0]["tile_length"] == file.stat().st_size > 0
    assert not set(TILE_COLUMNS) & set(rows[1])
