"""What a shard of a detection writes, beside shards that failed and runs that go on at the same time."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sqlalchemy import select

from apexcal.documents.detections import DetectionCounts
from service.platform.db.models import Analysis, Answer, Apex, Detection, Job, Person, Sensor, Vertex, VertexFrame
from service.platform.jobs.claims import claim, finishing
from service.platform.jobs.claims import finish as end_job
from service.platform.jobs.queue import enqueue_all
from tests.service.detections.seeding import COVARIANCE, answered, seed_recording, seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.rows import add
from workers.tasks import detecting
from workers.tasks.detecting import _camera_stamps, _marked_frames, _pair
from workers.tasks.vertex_rows import Pair
from workers.vertices.vertex import Detections, PoseFacts, SizeFacts
from workers.vertices.vertex import Vertex as Found

REGION = {"all": [{"quantity": "x", "op": ">", "value": 0}]}
PAIRING = {"mode": "nearest", "offset_ns": 0, "max_gap_ns": 100_000_000}


def found(*vertices, xyz=(5.0, 0.0, 0.5), **more):
    """Vertices of (sweep, time in ms)."""
    made = [Found(xyz, ms * 1_000_000, 7, sweep, 2, "tolerant", **more) for sweep, ms in vertices]
    return Detections(made, max(len(made), 1), {})


class Run:
    """A detection in a recording, whose shards a test ends in any order."""

    def __init__(self, database, recording, shards=1):
        self.database = database
        fleet_id, recording_id, self.camera_id = recording
        with database.writing() as session:
            asked = {"region": REGION, "pairing": PAIRING, "state": "running", "remaining": shards, "counts": {}}
            lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
            self.row = add(session, Detection, lidar, fleet_id=fleet_id, **asked)
            payloads = [{"first": number, "stop": number + 1} for number in range(shards)]
            of_run = {"kind": "detect", "fleet_id": fleet_id, "subject_id": self.row.id}
            self.jobs = [job.id for job in enqueue_all(session, payloads=payloads, **of_run)]

    def finish(self, shard, detections, pairs=(), wait=None):
        """End a shard with these vertices and their pairs in the camera."""
        held = claim(self.database, self.jobs[shard], f"w{self.jobs[shard]}")
        assert held
        if wait:
            wait()
        pairs = list(pairs) or [None] * len(detections.vertices)
        end_job(self.database, held, detecting.writing(self.row, detections, {self.camera_id: pairs}))

    def counts(self):
        with self.database.reading() as session:
            return session.get_one(Detection, self.row.id).counts


@pytest.fixture
def recording(database):
    fleet_id = make_fleet(database)
    recording_id, camera_id = seed_recording(database, seed_rig(database, fleet_id), 5)
    return fleet_id, recording_id, camera_id


@pytest.fixture
def make_run(database, recording):
    return lambda shards=1: Run(database, recording, shards)


def test_a_run_with_a_failed_shard_stays_failed_when_the_others_finish(database, make_run):
    run = make_run(2)
    held = claim(database, run.jobs[0], "w")
    with finishing(database, held, "failed", {"code": "worker_lost"}):
        pass
    run.finish(1, found((1, 100)), [Pair(1, 0)])
    with database.reading() as session:
        row = session.get_one(Detection, run.row.id)
        assert (row.state, row.problem) == ("failed", {"code": "worker_lost"})


def test_two_runs_at_once_find_one_apex(database, make_run):
    wait = threading.Barrier(2).wait
    ends = [make_run().finish for _ in range(2)]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda end: end(0, found((0, 0)), [Pair(0, 0)], wait), ends))
    with database.reading() as session:
        assert len(session.scalars(select(Apex)).all()) == 1


def test_a_frame_belongs_to_the_vertex_nearest_in_time_also_across_shards(database, make_run):
    run = make_run(2)
    run.finish(0, found((0, 0), (1, 60)), [Pair(0, 3), Pair(1, 40)])
    run.finish(1, found((2, 110)), [Pair(1, -10)])
    with database.reading() as session:
        rows = session.execute(select(VertexFrame.frame_index, VertexFrame.gap_ns).order_by(VertexFrame.frame_index))
        assert [tuple(row) for row in rows] == [(0, 3), (1, -10)]
        counts = run.counts()
        assert (counts["accepted"], counts["paired"], counts["frame_taken"]) == (3, 2, 1)
        marks = session.scalars(select(Analysis)).one()
        assert (marks.kind, marks.detection_id, marks.asked["camera"]) == ("machine_marks", run.row.id, "front")
        assert session.get_one(Job, marks.job_id).state == "queued"


def test_a_moved_vertex_has_no_gap_and_yet_the_nearest_keeps_the_frame(database, make_run):
    run = make_run()
    places = [{"x": x, "y": 0.0, "z": 0.5, "covariance": COVARIANCE} for x in (5.1, 5.2)]
    run.finish(0, found((0, 60), (1, 110)), [Pair(1, 0, {"top": place}) for place in places])
    with database.reading() as session:
        row = session.scalars(select(VertexFrame)).one()
        assert (row.gap_ns, row.x, row.covariance) == (0, 5.2, COVARIANCE)


def test_a_vertex_keeps_the_frame_that_people_marked(database, make_run, recording):
    _, recording_id, camera_id = recording
    make_run().finish(0, found((0, 60)), [Pair(0, -60)])
    with database.writing() as session:
        apex, person = session.scalars(select(Apex)).one(), add(session, Person, name="anna")
        marked = answered(recording_id, person.id, camera_id, 0, "confirmed", (8.0, 9.0))
        session.add(Answer(**marked, apex_id=apex.id))
    with database.reading() as session:
        marks, stamps = (
            each[camera_id]
            for each in (_marked_frames(session, apex.lidar_id), _camera_stamps(session, recording_id))
        )
    run = make_run()
    both = found((0, 60), (1, 5))
    pairs = _pair(both, stamps, PAIRING, marks)
    assert [pair.frame_index for pair in pairs] == [0, 0]
    run.finish(0, both, pairs)
    with database.reading() as session:
        vertices = select(Vertex.sweep_index).join(VertexFrame).where(Vertex.detection_id == run.row.id)
        assert session.scalars(vertices).all() == [0]


@pytest.mark.parametrize(
    ("x", "moved_m", "apexes"), [(5.0, 0.09, 1), (5.0, 0.11, 2), (30.0, 0.15, 1), (30.0, 0.17, 2)]
)
def test_another_run_finds_the_same_apex_within_a_decimetre_or_a_third_of_a_degree(
    database, make_run, x, moved_m, apexes
):
    for y in (0.0, moved_m):
        run = make_run()
        run.finish(0, found((0, 0), xyz=(x, y, 0.0)), [Pair(0, 0)])
    with database.reading() as session:
        assert len(session.scalars(select(Apex)).all()) == apexes


def test_what_a_detector_says_of_its_vertices_is_kept_and_counted_over_shards(database, make_run):
    run = make_run(2)
    covariance = ((1e-7, 0.0, 0.0), (0.0, 2e-7, 0.0), (0.0, 0.0, 1e-4))
    fine = found((0, 0), quality="fine", covariance=covariance)
    run.finish(0, fine, [Pair(0, 0)])
    run.finish(1, found((1, 100), quality="usable", flags=("head_above",)), [None])
    with database.reading() as session:
        rows = session.scalars(select(Vertex).order_by(Vertex.sweep_index)).all()
        assert [(row.quality, row.flags) for row in rows] == [("fine", []), ("usable", ["head_above"])]
        assert (rows[0].covariance, rows[1].covariance) == ([list(line) for line in covariance], None)
    counts = run.counts()
    assert (counts["quality"], counts["flags"]) == ({"fine": 1, "usable": 1}, {"head_above": 1})
    assert counts["paired"] == 1


def test_each_refused_sweep_is_kept_with_its_reason_whichever_shard_ends_first(make_run):
    run = make_run(2)
    later = Detections([], 4, {}, refused={6: "no_points", 7: "no_points", 8: "too_uncertain", 9: "no_points"})
    earlier = Detections([], 3, {}, refused={2: "too_uncertain", 3: "too_uncertain", 5: "no_points"})
    run.finish(1, later)
    run.finish(0, earlier)
    assert run.counts()["refused_sweeps"] == {"no_points": [[5, 7], [9, 9]], "too_uncertain": [[2, 3], [8, 8]]}


def test_how_the_board_was_rolled_is_told_over_all_shards(make_run):
    run = make_run(2)
    degrees = [10.0, 14.0, 9.0]
    rolled = [found((k, 100 * k), roll=(np.radians(deg), 0.01)).vertices[0] for k, deg in enumerate(degrees)]
    run.finish(0, Detections(rolled[:2], 2, {}), [None, None])
    run.finish(1, Detections(rolled[2:], 1, {}), [None])
    roll = run.counts()["roll"]
    assert roll["vertices"] == 3
    assert (roll["mean_deg"], roll["spread_deg"]) == pytest.approx((np.mean(degrees), np.std(degrees)))


def test_what_is_not_as_the_owner_said_is_kept_whichever_shard_says_it(make_run):
    run = make_run(2)
    size = SizeFacts((0.88, 1.2), (0.01, 0.01))
    poses = PoseFacts(8, True, walked=True)
    run.finish(1, Detections([], 4, {}, poses=poses, size=size))
    run.finish(0, Detections([], 3, {}, poses=poses, size=size))
    counts = DetectionCounts.model_validate(run.counts())
    assert (counts.poses, counts.poses_stated, counts.poses_walked) == (8, True, True)
    assert counts.size is not None and counts.size.seen_m == (0.88, 1.2)


def test_by_default_vertices_of_a_walk_move_to_their_frames_and_still_poses_stay():
    times = [100 * sweep for sweep in range(12)]
    pairing = {"mode": "auto", "offset_ns": 0, "max_gap_ns": 50_000_000}
    stamps = np.array([time + 20 for time in times], np.int64) * 1_000_000
    covariance = ((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 1e-4))

    def paired(step_m, stated=covariance):
        places = [(5.0 + step_m * (-1) ** sweep * (sweep % 7), 0.1 * sweep, 0.5) for sweep in range(len(times))]
        vertices = [
            Found(place, 1_000_000 * time, 7, sweep, 2, "refined", covariance=stated)
            for sweep, (place, time) in enumerate(zip(places, times, strict=True))
        ]
        return detecting._pair(Detections(vertices, 12, {}), stamps, pairing, {})

    walked = paired(0.0)
    assert all(pair.gap_ns == 0 and pair.places for pair in walked)
    assert walked[5].places["top"]["y"] == pytest.approx(0.52, abs=0.02), "20 ms at 1 m/s"
    assert all((pair.gap_ns, pair.places) == (20_000_000, {}) for pair in paired(0.5))
    assert all((pair.gap_ns, pair.places) == (20_000_000, {}) for pair in paired(0.0, None))


@pytest.mark.parametrize(
    ("places", "poses"), [((0.0,) * 6, 1), ((0.0, 1.0, 2.0, 3.0, 4.0, 5.0), 6), ((0.0, 0.02, 1.0, 1.03, 1.0, 3.0), 3)]
)
def test_the_number_of_poses_is_that_of_the_boards_places(make_run, places, poses):
    """Each sweep differs from the one before, because somebody walks behind the stand."""
    run = make_run(2)
    vertices = [Found((5.0, y, 0.5), 100_000_000 * k, 7, k, 2, "refined") for k, y in enumerate(places)]
    facts = PoseFacts(6, True)
    run.finish(1, Detections(vertices[4:], 2, {}, poses=facts), [None] * 2)
    run.finish(0, Detections(vertices[:4], 4, {}, poses=facts), [None] * 4)
    assert run.counts()["poses"] == poses
