"""Where the marking page looks for a corner: near the machine's mark, and not at it."""

import math
from itertools import pairwise

from service.platform.db.annotations import Disclosure
from service.platform.db.detections import VertexFrame
from tests.service.crops.marking import SIGMA_PX, progress, seed_blind, seed_marks, true_pixel
from tests.service.detections.seeding import seed_marking

# Massart's bound (1990) of Kolmogorov's distance D of n draws: P(D > c / sqrt(n)) < 2 exp(-2 c^2).
ONCE_IN_TEN_MILLION = math.sqrt(math.log(2e7) / 2.0)


def off_uniform(draws):
    """Kolmogorov's distance of draws from those that are alike likely anywhere between 0 and 1."""
    ranked, n = sorted(draws), len(draws)
    return max(max((rank + 1) / n - draw, draw - rank / n) for rank, draw in enumerate(ranked))


def test_they_lie_about_the_machines_marks_always_alike_and_tell_nothing_of_people(api, fleet):
    ida = api.member(fleet, "annotator", "Ida")
    seed = seed_marking(api.database, fleet, vertices=304)
    address = f"/detections/{seed.detection_id}/expected-corners?camera=front"
    assert ida.get(address).json() == []
    seed_marks(api.database, seed, refused=4)
    expected = ida.get(address).json()
    seed_blind(api, seed, range(5), off=(30.0, 0.0))
    assert ida.get(address).json() == expected

    ranks = {str(vertex): rank for rank, vertex in enumerate(seed.vertices)}
    assert [ranks[one["vertex_id"]] for one in expected] == list(range(300))
    offsets = []
    for one in expected:
        u, v = true_pixel(ranks[one["vertex_id"]])
        offsets.append((one["u"] - u, one["v"] - v))
        # A good mark with a deviation of a pixel lies outside once in a thousand.
        beside = 3.717 * math.hypot(1.0, SIGMA_PX)
        assert math.hypot(*offsets[-1]) + beside <= one["within_px"] + 1e-3
    # Alike likely anywhere in a ring of an eighth to a quarter of the crop's side, 7.5 to 15 px.
    areas, turns = [(math.hypot(*one) / 15.0) ** 2 for one in offsets], [math.atan2(*one) for one in offsets]
    assert all(0.25 - 1e-9 <= area <= 1.0 + 1e-9 for area in areas)
    shares = [(area - 0.25) / 0.75 for area in areas]
    assert off_uniform(shares) < ONCE_IN_TEN_MILLION / math.sqrt(300), "the machine's mark is told or all too far"
    assert off_uniform([turn / math.tau + 0.5 for turn in turns]) < ONCE_IN_TEN_MILLION / math.sqrt(300)
    # Within a millionth of a pixel of one another by chance: once in 10^11 runs.
    assert all(math.dist(a, b) > 1e-6 for a, b in pairwise(offsets))


def test_two_places_are_told_offered_as_no_mark_and_what_is_answered_there_is_reviewed(api, fleet):
    ida = api.member(fleet, "annotator", "Ida")
    seed = seed_marking(api.database, fleet, vertices=8)
    places = [{"u": 300.0, "v": 200.0, "weight": 0.6}, {"u": 304.0, "v": 208.0, "weight": 0.4}]
    analysis = seed_marks(api.database, seed, refused=1, places=places)
    open_vertex = str(seed.vertices[-1])

    expected = ida.get(f"/detections/{seed.detection_id}/expected-corners?camera=front").json()
    (corner,) = [one for one in expected if one["places"]]
    assert (corner["vertex_id"], corner["places"]) == (open_vertex, places)
    assert all(math.dist((corner["u"], corner["v"]), (one["u"], one["v"])) < corner["within_px"] for one in places)
    assert progress(ida, seed)["marks"] == 7 and progress(ida, seed)["next_unmarked"] == open_vertex

    # Who was told both places is no independent marker of that corner, and still one of all others.
    with api.database.reading() as session:
        (told,) = session.query(Disclosure).filter_by(person_id=ida.person_id).all()
        frame = session.get_one(VertexFrame, (seed.vertices[-1], seed.camera_id))
        assert (told.frame_index, told.corner) == (frame.frame_index, "top")

    reviewer = api.member(fleet, "reviewer", "Rex")
    marks = reviewer.get(f"/analyses/{analysis}/marks").json()["marks"]
    (mark,) = [one for one in marks if one["reason"]]
    assert (mark["vertex_id"], mark["reason"], mark["u"], mark["places"]) == (open_vertex, "two_places", None, places)
