"""Points of pixels over HTTP: the truth of a simulated road lies within what is stated as often as that says."""

import numpy as np
import pytest
from scipy import stats

from apexcal.documents.pixel_points import LocatedPixels
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, to_document
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection
from service.platform.db.recordings import Recording, Sensor
from tests.contract.test_validations import LENS, SIZE, bag_of_a_drive
from tests.service.detections.seeding import seed_rig
from tests.support.databases import one_database
from tests.support.results import fit_result
from tests.support.rows import LEVEL, add
from tests.support.scenes.drive import Drive
from tests.support.scenes.road import LIDAR_HEIGHT_M, draw_road
from tests.support.scenes.road_rays import cast_rays
from tests.support.work import work
from tests.workers.readers.making_recordings import START_NS
from tests.workers.tasks.test_ingesting import uploaded
from tests.workers.validation.roads import camera

pytestmark = one_database

DRIVE = Drive(speed_m_s=0.0, bias_m=0.0)
NOISE = {
    "range_m": DRIVE.noise_m,
    "shared_m": 0.0,
    "angle_deg": 0.005,
}  # the beams are exact; a LiDAR whose are is none
NAMES = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z", "f_x", "f_y")
DEVIATIONS = np.array([*[0.1] * 3, *[0.01] * 3, 1.0, 1.0])  # degrees, metres, pixels
SIGMA_PX = 3.0
TRUTH = camera(*SIZE)
AT = np.array([0.0, 0.0, LIDAR_HEIGHT_M])


def surface_points(pixels):
    """Where the true rays of pixels (N, 2) meet the road, LiDAR frame; not finite where they meet nothing."""
    rays = TRUTH.rays(pixels)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    origins = np.repeat((AT + TRUTH.centre())[None], len(rays), axis=0)
    distance = cast_rays(draw_road(5), origins, rays)[0]
    return origins - AT + rays * distance[:, None]


def lies_in_a_plane(pixel):
    """Whether all that the cone of a pixel may hold is one plane, not seen from its edge."""
    around = np.array([(a, b) for a in np.linspace(-25, 25, 6) for b in np.linspace(-25, 25, 6)])
    points = surface_points(pixel + around)
    if not np.isfinite(points).all() or np.linalg.norm(points, axis=1).max() > 40.0:
        return False
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred)[2][2]
    middle = points.mean(axis=0) / np.linalg.norm(points.mean(axis=0))
    return np.abs(centred @ normal).max() < 1e-6 and abs(normal @ middle) > 0.3


def seed_result(database, rig, errors, pairing=None):
    """A result whose calibration is off by these errors of NAMES, and that states their deviations."""
    mount = TRUTH.T_camera_lidar
    R = rotation_from_vector(np.radians(errors[:3])) @ mount.R
    lens = TRUTH.intrinsics_document()
    document = fit_result(
        intrinsics=lens | {"f_x": lens["f_x"] + errors[6], "f_y": lens["f_y"] + errors[7]},
        transform=to_document(SE3(mount.to_frame, mount.from_frame, R, mount.t + errors[3:6])),
        covariance={"names": list(NAMES), "units": [""] * 8, "matrix": np.diag(DEVIATIONS**2).tolist()},
    )
    with database.writing() as session:
        calibration = add(session, Calibration, rig)
        recording = session.query(Recording).one()
        lidar = session.query(Sensor).filter_by(kind="lidar").one()
        detection = add(session, Detection, recording, lidar, content_hash=str(calibration.id), pairing=pairing or {})
        pairs = add(session, CorrespondenceSet, rig, content_hash=calibration.id.hex, detection_id=detection.id)
        run = add(session, CalibrationRun, calibration, pairs)
        return str(add(session, Result, run, document=document).id)


@pytest.fixture
def street(api, context, tmp_path):
    """An engineer, a rig, and a recording of a road on which the vehicle stands."""
    fleet = api.fleet()
    rig = seed_rig(api.database, fleet)
    recording = uploaded(context, rig, bag_of_a_drive(tmp_path / "drive.bag", drive=DRIVE))
    work(context)
    return api.member(fleet, "engineer"), rig, {"kind": "pixel_points", "recording_id": str(recording.id)}


def ask(engineer, body):
    asked = engineer.post("/analyses", body)
    assert asked.status_code == 202, asked.text
    return f"/analyses/{asked.json()['id']}"


def test_the_truth_lies_within_the_stated_covariance(api, context, street):
    """16 drawn calibrations, four pixels each, one draw of the LiDAR's noise for each of three sweeps."""
    engineer, rig, body = street
    rng = np.random.default_rng(11)
    truths, paths = [], []
    for draw in range(16):
        pixels = []
        while len(pixels) < 4:
            pixel = rng.uniform((40, 40), np.array(SIZE) - 40)
            pixels += [pixel] if lies_in_a_plane(pixel) else []
        truths.append(surface_points(np.array(pixels)))
        marks = np.array(pixels) + rng.normal(0, SIGMA_PX, (4, 2))
        result = seed_result(api.database, rig, rng.normal(0, DEVIATIONS))
        marked = [{"u": u, "v": v, "sigma_px": SIGMA_PX} for u, v in marks.tolist()]
        moment = {"frame": draw % 3, "lidar_noise": NOISE, "camera": "front", "result_id": result}
        paths.append(ask(engineer, body | moment | {"pixels": marked}))
    work(context)
    squares = []
    for path, truth in zip(paths, truths, strict=True):
        done = engineer.get(path).json()
        assert (done["state"], done["problem"], done["camera"]) == ("done", None, "front")
        located = LocatedPixels.model_validate(done["result"])
        assert not located.model_extra
        for pixel, where in zip(located.pixels, truth, strict=True):
            assert pixel.origin and len(pixel.direction_covariance) == 3
            if pixel.point is None:
                assert pixel.reason
                continue
            error = np.array(pixel.point) - where
            squares.append(error @ np.linalg.solve(pixel.covariance, error))
            assert np.dot(pixel.normal, pixel.direction) < 0 and len(pixel.points) >= 4
    # The others lie below the lowest ring, or between two.
    assert len(squares) >= 38
    for share in (0.5, 0.95):
        inside = np.mean(np.array(squares) < stats.chi2.ppf(share, 3))
        # Three deviations of 16 draws: the pixels of one share the calibration's error.
        assert abs(inside - share) < 3.0 * np.sqrt(share * (1 - share) / 16), (share, inside, len(squares))
    assert np.mean(squares) < 4.0, "3 if the covariances hold; one point on another surface would cost 100"


def test_a_moment_is_a_frame_or_a_stamp_and_each_pixel_has_its_reason(api, context, street):
    engineer, rig, body = street
    result = seed_result(api.database, rig, np.zeros(8))
    pixels = [{"u": 320.0, "v": 380.0, "sigma_px": 5.0}, {"u": 900.0, "v": 10.0}, {"u": 320.0, "v": 5.0}]
    body = body | {"camera": "front", "result_id": result, "pixels": pixels}
    by_frame = ask(engineer, body | {"frame": 0})
    by_stamp = ask(engineer, body | {"stamp_ns": START_NS + 1})
    far = ask(engineer, body | {"stamp_ns": START_NS + 10**10})
    elsewhere = seed_result(api.database, rig, np.zeros(8), {"offset_ns": 10**10})
    late = ask(engineer, body | {"frame": 0, "result_id": elsewhere})
    in_time = ask(engineer, body | {"frame": 0, "result_id": elsewhere, "clock_offset_ns": 0})
    small = {"lens": LENS | {"width": 320}, "transform": LEVEL}
    other_size = ask(engineer, body | {"frame": 0, "calibration": small, "result_id": None})
    work(context)
    done = engineer.get(by_frame).json()["result"]
    assert done == engineer.get(by_stamp).json()["result"] == engineer.get(in_time).json()["result"]
    assert done["sweep"] == 0
    ground, outside, sky = done["pixels"]
    assert ground["reason"] is None and abs(ground["point"][2] + LIDAR_HEIGHT_M) < 0.1
    assert "outside of the image" in outside["reason"] and outside["origin"] is None
    assert sky["points"] == [] and "0 points lie in the cone" in sky["reason"] and sky["direction"]
    for path, code in ((far, "no_sweep_then"), (late, "no_sweep_then"), (other_size, "image_size_differs")):
        failed = engineer.get(path).json()
        assert (failed["state"], failed["problem"]["code"]) == ("failed", code)
    for wrong, status, code in (
        ({"frame": 99}, 404, "unknown_frame"),
        ({"frame": 0, "stamp_ns": START_NS}, 422, "invalid_request"),
        ({}, 422, "invalid_request"),
        ({"frame": 0, "pixels": pixels * 17}, 422, "invalid_request"),
        ({"frame": 0, "pixels": [{"u": 1.0, "v": 1.0, "sigma_px": 0.0}]}, 422, "invalid_request"),
    ):
        refused = engineer.post("/analyses", body | wrong)
        assert (refused.status_code, refused.json()["code"]) == (status, code), refused.text
