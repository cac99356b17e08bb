"""The file by which the pages' overlay is tested says what ``workers/overlays`` says."""

import json

import numpy as np
import pytest

from tests.workers.overlays.overlay_vectors import FILE, document


def test_the_vectors_are_of_workers_overlays() -> None:
    given, wanted = json.loads(FILE.read_text()), json.loads(json.dumps(document()))
    for name in ("size", "vertices", "sweep"):
        assert given[name] == wanted[name]
    for one, other in zip(given["cases"], wanted["cases"], strict=True):
        assert {name: one[name] for name in ("intrinsics", "transform", "at_ns", "hidden")} == {
            name: other[name] for name in ("intrinsics", "transform", "at_ns", "hidden")
        }
        assert (one["moved"] is None) == (other["moved"] is None)
        if one["moved"]:
            assert one["moved"]["count"] == other["moved"]["count"] > 10
            assert one["moved"]["farthest_m"] == pytest.approx(other["moved"]["farthest_m"], abs=1e-9)
        # Of all around, a part is before the camera, and of that the panel and the board hide a part.
        assert 100 < len(one["pixels"]) < 1000 and one["hidden"] >= 10
        assert np.abs(np.array(one["pixels"]) - np.array(other["pixels"])).max() < 2e-9
        assert np.abs(np.array(one["distance_m"]) - np.array(other["distance_m"])).max() < 2e-4
