"""A file for viewers puts every point where we put it, in recorded and in undistorted frames."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from service.analyses.viewer_plan import viewer_file
from tests.service.exports.rigs import HEIGHT, LENSES, WIDTH, ours, rig_of, seen
from tests.workers.readers.making_recordings import START_NS, clouds, images, interleaved, write_bag
from tests.workers.readers.viewing.reading_viewer_files import chain, distorted, messages, rectified, stamp_ns
from workers.geometry.projection import project
from workers.readers.normalised.normalise import normalise
from workers.readers.normalised.sensor_files import SweepFile
from workers.readers.normalised.sensor_writers import SweepWriter
from workers.readers.recording import LidarFacts, Sensor, Sweep
from workers.readers.viewing.viewer_file import write_viewer_file
from workers.tasks.viewing import write_map

LIMIT_PX = 1e-4
OFFSET_NS = 12_000_000  # frames are stamped so long after the sweep's start
DOTS = 25
RADIUS_PX = 6.0


def dotted(pixels):
    """A grey JPEG with a bright, round dot at each of these places."""
    image = np.zeros((HEIGHT, WIDTH), np.float32)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    for at_u, at_v in pixels:
        place = np.s_[int(at_v) - 30 : int(at_v) + 31, int(at_u) - 30 : int(at_u) + 31]
        squared = (u[place] - at_u) ** 2 + (v[place] - at_v) ** 2
        image[place] += 255 * np.exp(-squared / (2 * RADIUS_PX**2))
    return cv2.imencode(".jpg", np.clip(image, 0, 255).astype(np.uint8))[1].tobytes()


def dots(camera):
    """Points in the LiDAR's frame whose dots do not touch: (N, 3)."""
    points, pixels = seen(camera), ours(camera)
    chosen = []
    for n in range(len(points)):
        apart = all(np.hypot(*(pixels[n] - pixels[m])) > 100 for m in chosen)
        if apart and (pixels[n] > 60).all() and (pixels[n] < [WIDTH - 60, HEIGHT - 60]).all():
            chosen.append(n)
    return points[chosen[:DOTS]]


def centre(image, at):
    """Of the brightness around a place: where its dot lies."""
    u, v = np.rint(at).astype(int)
    part = image[v - 25 : v + 26, u - 25 : u + 26].astype(float)
    part[part < 30] = 0
    rows, columns = np.mgrid[v - 25 : v + 26, u - 25 : u + 26]
    return np.array([(part * columns).sum(), (part * rows).sum()]) / part.sum()


def written(tmp_path, cameras, plan, frames=(), count=2):
    """The viewer's file of a bag with these cameras' frames (encoded images by camera)."""
    of = {camera.name: f"/{camera.name}/compressed" for camera in cameras}
    recorded = [images(count, of[name], data) for name, data in frames]
    bag = write_bag(tmp_path / "walk.bag", interleaved(clouds(3), *recorded))
    out = tmp_path / "normalised"
    manifest = normalise(bag, out, cameras={name: of[name] for name, _ in frames})
    files = {one.name: one for one in manifest.sensors}
    for camera in plan["cameras"]:
        name = camera["name"]
        places = {"file": files[name].file, "map": f"{name}.npy"}
        camera |= {kind: str(out / place) for kind, place in places.items()}
        write_map(out / f"{name}.npy", camera, lambda: None)
        del camera["model"], camera["intrinsics"]
    for pose in plan["poses"]:
        del pose["is_new"]
    made = write_viewer_file(out / "lidar.sweeps", tmp_path / "out", plan | {"facts": {"a": "b"}}, lambda share: None)
    return tmp_path / "out" / made["file"], made


@pytest.mark.parametrize(("model", "rig"), [*((model, 0) for model in LENSES), ("brown_conrady", 1)])
def test_points_fall_where_ours_do_and_undistorted_frames_show_them_there(tmp_path, model, rig):
    cameras = rig_of(model, rig).cameras
    marked = {one.name: dots(one) for one in cameras}
    frames = []
    for one in cameras:
        T = one.T_camera_lidar
        pixels, _ = project(one.model, one.intrinsics, marked[one.name] @ T.R.T + T.t)
        frames.append((one.name, dotted(pixels)))
    plan = viewer_file(cameras, "velodyne", dict.fromkeys(marked, "camera"), {})
    path, made = written(tmp_path, cameras, plan, frames, count=1)
    assert (made["copied"], made["left_out"]) == (6, 0)
    (_, _, tree), *_ = messages(path, "/tf")
    for one in cameras:
        found = {channel.topic: decoded for channel, _, decoded in messages(path) if f"/{one.name}/" in channel.topic}
        raw, flat = (found[f"/{one.name}/{kind}/calibration"] for kind in ("raw", "undistorted"))
        picture = found[f"/{one.name}/undistorted/image"]
        assert raw.frame_id == flat.frame_id == picture.frame_id == found[f"/{one.name}/raw/image"].frame_id
        R, t = chain(tree.transforms, raw.frame_id, "velodyne")
        points = seen(one) @ R.T + t
        assert np.abs(distorted(raw, points) - ours(one)).max() < LIMIT_PX
        T = one.T_camera_lidar
        pinhole, _ = project("pinhole", [one.intrinsics[n] for n in ("f_x", "f_y", "c_x", "c_y")], points)
        assert np.abs(rectified(flat, points) - pinhole).max() < LIMIT_PX
        assert np.abs(rectified(flat, points) - rectified(flat, seen(one) @ T.R.T + T.t)).max() < LIMIT_PX
        assert flat.distortion_model == "plumb_bob" and not any(flat.D)
        image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert image.shape == (flat.height, flat.width) == (HEIGHT, WIDTH) and picture.format == "jpeg"
        expected = rectified(flat, marked[one.name] @ R.T + t)
        inside = ((expected > 40) & (expected < [WIDTH - 40, HEIGHT - 40])).all(axis=1)
        assert inside.sum() >= 8
        away = [np.hypot(*(centre(image, at) - at)) for at in expected[inside]]
        assert max(away) < 0.5, "of a dot that the lens stretches"


def test_frames_are_stamped_by_the_lidars_clock_and_points_are_the_recordings(tmp_path):
    cameras = rig_of("kannala_brandt", 0).cameras[:1]
    plan = viewer_file(cameras, "velodyne", {"front": "velodyne"}, {"front": OFFSET_NS})
    path, made = written(tmp_path, cameras, plan, [("front", dotted([]))])
    every = messages(path)
    assert [at for _, at, _ in every] == sorted(at for _, at, _ in every)
    assert all(stamp_ns(one) == at for channel, at, one in every if channel.topic != "/tf")
    tree = messages(path, "/tf")
    assert [at for _, at, _ in tree] == [START_NS, *(START_NS + n * 100_000_000 for n in (1, 2))]
    assert {stamp_ns(one) for _, at, two in tree for one in two.transforms if at == START_NS} == {START_NS}
    assert [at - START_NS for _, at, _ in messages(path, "/front/raw/image")] == [0, 100_000_000]
    # The recording names both frames alike, so the camera has the rig's name.
    assert {one.frame_id for _, _, one in messages(path, "/front/raw/image")} == {cameras[0].frame}
    with SweepFile(tmp_path / "normalised" / "lidar.sweeps") as sweeps:
        for (_, at, cloud), sweep in zip(messages(path, "/lidar"), sweeps.sweeps(), strict=True):
            assert (cloud.frame_id, at) == ("velodyne", sweep.stamp_ns)
            columns = {one.name: (one.offset, one.type) for one in cloud.fields}
            numeric = type(cloud.fields[0]).NumericType
            assert columns["x"][1] == numeric.Value("FLOAT32") and columns["ring"][1] == numeric.Value("UINT16")
            points = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
            assert (points[:, :12].copy().view("<f4") == sweep.xyz).all() and cloud.pose.orientation.w == 1.0
            at_ring = columns["ring"][0]
            assert (points[:, at_ring : at_ring + 2].copy().view("<u2")[:, 0] == sweep.ring).all()
    assert made["added"] == 3 + 2 * 3


def test_a_skew_is_left_out_of_what_viewers_read_and_taken_out_of_undistorted_frames(tmp_path):
    cameras = rig_of("brown_conrady", 0, skew=0.05).cameras[:1]
    (camera,) = cameras
    T, points = camera.T_camera_lidar, dots(camera)
    pixels, _ = project(camera.model, camera.intrinsics, points @ T.R.T + T.t)
    plan = viewer_file(cameras, "velodyne", {"front": "camera"}, {})
    path, _ = written(tmp_path, cameras, plan, [("front", dotted(pixels))], count=1)
    assert messages(path, "/front/raw/calibration") == []
    ((_, _, picture),) = messages(path, "/front/undistorted/image")
    ((_, _, flat),) = messages(path, "/front/undistorted/calibration")
    image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    expected = rectified(flat, points @ T.R.T + T.t)
    inside = ((expected > 40) & (expected < [WIDTH - 40, HEIGHT - 40])).all(axis=1)
    assert max(np.hypot(*(centre(image, at) - at)) for at in expected[inside]) < 0.5


def test_frames_that_cannot_be_undistorted_are_counted(tmp_path):
    cameras = rig_of("pinhole", 0).cameras[:2]
    other = cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes()
    whole = cv2.imencode(".png", np.zeros((HEIGHT, WIDTH), np.uint8))[1].tobytes()
    plan = viewer_file(cameras, "velodyne", {"front": "a", "left.rear": "b"}, {})
    path, made = written(tmp_path, cameras, plan, [("front", other), ("left.rear", whole)])
    assert made["left_out"] == 2 and messages(path, "/front/undistorted/image") == []
    assert len(messages(path, "/front/raw/image")) == 2


FOLDING = rig_of("brown_conrady", 0, k1=-0.45, k2=0.0, k5=0.0, f_x=500.0, f_y=500.0).cameras[0]
TALL_LENS = {"f_x": 900.0, "f_y": 900.0, "c_x": 300.0, "c_y": 500.0}
TALL = replace(rig_of("pinhole", 0).cameras[0], width=600, height=1000, intrinsics=TALL_LENS)


@pytest.mark.parametrize(("camera", "corner"), [(FOLDING, 0), (TALL, 255)], ids=["folding", "tall"])
def test_frames_are_undistorted_at_their_own_size_and_black_where_the_lens_sees_nothing(tmp_path, camera, corner):
    """Past its fold a lens would show the same ring again."""
    plan = viewer_file([camera], "velodyne", {"front": "camera"}, {})
    white = cv2.imencode(".png", np.full((camera.height, camera.width), 255, np.uint8))[1].tobytes()
    path, made = written(tmp_path, [camera], plan, [("front", white)], count=1)
    ((_, _, picture),) = messages(path, "/front/undistorted/image")
    image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (camera.height, camera.width) and made["left_out"] == 0
    assert abs(int(image[0, 0]) - corner) < 5 and abs(int(image[-1, -1]) - corner) < 5
    assert image[camera.height // 2, camera.width // 2] > 250 and (corner == 0 or image.min() > 250)


def test_our_own_reader_takes_it_for_a_recording(tmp_path):
    cameras = rig_of("pinhole", 0).cameras[:1]
    plan = viewer_file(cameras, "velodyne", {"front": "camera"}, {})
    path, _ = written(tmp_path, cameras, plan, [("front", dotted([]))])
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values()) == 14
    manifest = normalise(path, tmp_path / "again", cameras={"front": "/front/raw/image"})
    lidar, camera = manifest.sensors
    assert (lidar.count, camera.count, camera.frame_id) == (3, 2, "camera")
    assert camera.camera_info.K[0] == pytest.approx(cameras[0].intrinsics["f_x"], abs=0)


def peak(tmp_path, sweeps):
    """Highest resident memory of the child that writes the file of so many sweeps of 0.7 MB, bytes."""
    random = np.random.default_rng(3)
    out = tmp_path / str(sweeps)
    out.mkdir()
    facts = LidarFacts(1, 10**8, "start", "derived_from_azimuth", ())
    writer = SweepWriter(out / "lidar.sweeps", Sensor("lidar", "/points", "velodyne", None), facts)
    for n in range(sweeps):
        at_ns = START_NS + n * 100_000_000
        xyz, ring = random.normal(0, 10, (30_000, 3)).astype(np.float32), np.zeros(30_000, np.uint16)
        writer.add(Sweep(at_ns, xyz, xyz[:, 0], ring, np.zeros(30_000, np.int64), "derived_from_azimuth"))
    writer.finish(START_NS + 100_000_000 * np.arange(sweeps), np.arange(sweeps))
    request = {"view": {"lidar_frame": "velodyne", "cameras": [], "poses": [], "facts": {}}}
    command = [sys.executable, "-m", "workers.readers", str(out / "lidar.sweeps"), str(out / "made")]
    done = subprocess.run([*command, "--request", json.dumps(request)], capture_output=True, text=True, check=True)
    last = json.loads(done.stdout.splitlines()[-1])
    assert last["file"]["copied"] == sweeps and last["used"]["written_bytes"] > sweeps * 400_000
    return last["used"]["resident_bytes"]


def test_memory_does_not_grow_with_the_recording(tmp_path):
    assert peak(tmp_path, 90) - peak(tmp_path, 15) < 12_000_000
