from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.analyses import SuggestionFacts
from apexcal.documents.errors import InputError
from apexcal.documents.simulation import Disturbances
from tests.support.scenes.flawed_lidar import FlawedLidar, Mount
from tests.support.scenes.still import drive
from workers.simulation.beams import BOARD, PERSON
from workers.simulation.scene import scene_with
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import Walk
from workers.vertices.region import Region
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed

START_NS = 1_780_000_000_000_000_000


def recorded(seed, sweeps=150, plan="field", mount=None, **disturbances):
    """(sweep, labels) ten times a second."""
    spoiled = Disturbances(**disturbances)
    scene = scene_with(spoiled.poles, seed)
    way = Walk(seed, sweeps * 0.1, scene.ground_z, plan=plan, disturbances=spoiled)
    how = {"sector_deg": 55, "noise_m": 0.008, "seed": seed, "disturbances": spoiled, "mount": mount or Mount()}
    lidar = FlawedLidar(SENSORS["vlp16"], scene, way, **how)
    return [lidar.labelled_sweep(i, 0.1 * i, START_NS + 100_000_000 * i) for i in range(sweeps)]


def kept(recording, document):
    """Share of the board's points inside, and the mean number per sweep of points that are no walker's."""
    region = Region.from_document(document)
    board = inside = others = 0
    for sweep, surface in recording:
        mask = region.mask(sweep.xyz)
        board += np.count_nonzero(surface == BOARD)
        inside += np.count_nonzero(mask & (surface == BOARD))
        others += np.count_nonzero(mask & (surface != BOARD) & (surface != PERSON))
    return inside / board, others / len(recording)


def test_the_suggestion_keeps_the_board_and_next_to_nothing_else():
    recording = recorded(1)
    suggestion = suggest(Listed([sweep for sweep, _ in recording]), samples=100)
    share, others = kept(recording, suggestion.document)
    assert share >= 0.99
    assert others < 0.1
    facts = suggestion.facts
    assert set(facts) == set(SuggestionFacts.model_fields)
    assert (facts["sweeps_read"], facts["sweeps_moving"]) == (100, pytest.approx(100, abs=5))
    assert facts["ground_z"] == pytest.approx(-1.85, abs=0.02)
    assert facts["notes"] == []
    assert facts["points_per_sweep"] > 5


def test_rain_and_lost_returns_do_not_widen_it():
    recording = recorded(3, 100, speckle=0.01, dropouts=0.05)
    clean = suggest(Listed([sweep for sweep, _ in recorded(3, 100)]))
    wet = suggest(Listed([sweep for sweep, _ in recording]))
    share, others = kept(recording, wet.document)
    assert share >= 0.99
    assert others < 8
    assert wet.facts["area_m2"] < 1.5 * clean.facts["area_m2"]


def test_posts_inside_are_cut_out():
    """A post taller than the board would be the highest ring of every sweep."""
    recording = recorded(1, sweeps=250, poles=3)
    suggestion = suggest(Listed([sweep for sweep, _ in recording]))
    share, others = kept(recording, suggestion.document)
    assert suggestion.facts["posts"] >= 1
    assert "cut out" in suggestion.facts["notes"][0]
    assert share >= 0.98
    assert others < 0.1


def test_nothing_moves():
    recording = recorded(1, 80, "still")
    with pytest.raises(InputError) as caught:
        suggest(Listed([sweep for sweep, _ in recording]))
    assert caught.value.code == "nothing_moves"
    assert "Walk" in caught.value.hint
    single = suggest(Listed([sweep for sweep, _ in recording[::10]]), still=True)
    assert kept(recording, single.document)[0] > 0.95
    assert single.facts["poses"] == 1


def test_too_few_sweeps_and_a_lidar_that_moves_are_told():
    random = np.random.default_rng(0)
    seen = [sweep for sweep, _ in recorded(1, 10)]
    moved = [replace(sweep, xyz=(sweep.xyz + random.uniform(-3, 3, 3)).astype(np.float32)) for sweep in seen]
    for sweeps, code in ((moved, "everything_moves"), (seen[:7], "too_few_sweeps")):
        with pytest.raises(InputError) as caught:
            suggest(Listed(sweeps))
        assert caught.value.code == code


def test_empty_sweeps_and_a_wild_ring_number_do_no_harm_and_progress_is_told():
    recording = [sweep for sweep, _ in recorded(2, 80)]
    columns = ("xyz", "intensity", "ring", "offset_ns")
    for index in (10, 11):
        nothing = {name: getattr(recording[index], name)[:0] for name in columns}
        recording[index] = replace(recording[index], **nothing)
    ring = recording[30].ring.copy()
    ring[:3] = 65535
    recording[30] = replace(recording[30], ring=ring)
    told = []
    suggestion = suggest(Listed(recording), on_sweep=told.append)
    assert suggestion.facts["sweeps_read"] == 80
    read = [number for number in told if number]  # before that it is looked whether these are poses, or a drive
    assert read == [*range(1, 81)]


@pytest.mark.parametrize(
    "mount",
    [Mount(roll_deg=-20.0), Mount(pitch_deg=10.0), Mount(roll_deg=165.0)],
    ids=["rolled by -20", "looks down by 10", "tilted, upside down"],
)
def test_the_suggestion_of_a_tilted_sensor_is_level(mount):
    """Before, its heights were those of the sensor's z: it held ground to one side and cut boards to the other."""
    recording = recorded(6, 120, mount=mount)
    suggestion = suggest(Listed([sweep for sweep, _ in recording]), samples=100)
    share, others = kept(recording, suggestion.document)
    assert share >= 0.99
    assert others < 0.3
    np.testing.assert_allclose(suggestion.document["up"], mount.rotation()[2], atol=0.01)
    assert suggestion.facts["ground_z"] == pytest.approx(-1.85, abs=0.05)
    assert ("hangs" if mount.roll_deg > 90.0 else "tilted by") in suggestion.facts["notes"][0]


def test_a_drive_with_a_tilted_sensor_is_refused():
    turn = Mount(roll_deg=15.0).rotation().astype(np.float32)
    driven = drive(0, 12)
    moving = [replace(one, xyz=one.xyz @ turn) for one in map(driven.sweep, range(len(driven)))]
    with pytest.raises(InputError) as refused:
        suggest(Listed(moving))
    assert refused.value.code == "everything_moves"
