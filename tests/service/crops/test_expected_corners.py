"""Where the marking page looks for a corner: near the machine's mark, and not at it."""

import math
from itertools import pairwise

from tests.service.crops.marking import SIGMA_PX, seed_blind, seed_marks, true_pixel
from tests.service.detections.seeding import seed_marking


def test_they_lie_about_the_machines_marks_always_alike_and_tell_nothing_of_people(api, fleet):
    ida = api.member(fleet, "annotator", "Ida")
    seed = seed_marking(api.database, fleet, vertices=60)
    address = f"/detections/{seed.detection_id}/expected-corners?camera=front"
    assert ida.get(address).json() == []
    seed_marks(api.database, seed, refused=4)
    expected = ida.get(address).json()
    seed_blind(api, seed, range(5), off=(30.0, 0.0))
    assert ida.get(address).json() == expected

    ranks = {str(vertex): rank for rank, vertex in enumerate(seed.vertices)}
    assert [ranks[one["vertex_id"]] for one in expected] == list(range(56))
    offsets = []
    for one in expected:
        u, v = true_pixel(ranks[one["vertex_id"]])
        offsets.append((one["u"] - u, one["v"] - v))
        # A good mark with a deviation of a pixel lies outside once in a thousand.
        beside = 3.717 * math.hypot(1.0, SIGMA_PX)
        assert math.hypot(*offsets[-1]) + beside <= one["within_px"] + 1e-3
    lengths = sorted(math.hypot(*one) for one in offsets)
    # Alike likely in a disc of a quarter of the crop's side, 15 px: half of them beyond 0.7 of it.
    assert lengths[-1] <= 15.0 and 8.0 < lengths[len(lengths) // 2] < 13.0 and lengths[0] > 0.1
    assert all(math.dist(a, b) > 1e-6 for a, b in pairwise(offsets))
