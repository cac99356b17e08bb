import json
from dataclasses import asdict

import numpy as np
import pytest

from apexcal.documents.errors import InputError
from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import rotation_from_euler
from apexcal.geometry.se3 import SE3, to_document
from tests.workers.vertices.walks import START_NS, seconds, vertices, walk
from workers.simulation.camera import CAMERA_FRAME, LIDAR_FRAME, make_camera, nominal_mount
from workers.solver import clock_offset, offset_fit
from workers.solver.outcomes import SolveError
from workers.vertices.pairing import pair
from workers.vertices.tracks import Track

MS = 1_000_000
LENGTH_S = 60.0


def estimate_offset(track, stamps, pixels, request, **named):
    """The estimate of a request that is not complete."""
    return clock_offset.estimate_offset(track, stamps, pixels, fit_request(**request), **named)


def marked(seed, offset_ns, *, plan="rows", model="brown_conrady", wrong=0.0, length_s=LENGTH_S, share=0.35):
    """Track, stamps and marks of the frames that were paired under no offset, and the request."""
    random = np.random.default_rng([seed, 9])
    way = walk(seed, length_s, plan)
    found = vertices(way, seed, length_s, share=share)
    camera = make_camera(model, seed)
    moments = START_NS + np.round((0.03 + np.arange(0, length_s - 1, 1 / 14.98)) * 1e9).astype(np.int64)
    index, _ = pair([v.time_ns for v in found], moments + offset_ns, max_gap_ns=50 * MS)
    frames = np.unique(index[index >= 0])
    pixels = camera.project(way.poses(seconds(moments[frames])).apex)
    seen = camera.sees(pixels)
    pixels = pixels[seen] + random.normal(size=(int(seen.sum()), 2))
    blunder = random.random(len(pixels)) < wrong
    pixels[blunder] += random.uniform(-80, 80, (int(blunder.sum()), 2))
    request = {"model": model, "image_size": camera.image_size, "nominal": to_document(nominal_mount())}
    return Track.of(found), moments[frames][seen] + offset_ns, pixels, request


@pytest.mark.parametrize(
    ("model", "offsets"),
    [("brown_conrady", (-60 * MS, 43 * MS)), ("pinhole", (60 * MS,)), ("kannala_brandt", (-40 * MS,))],
)
def test_a_minute_of_walking_tells_the_offset_and_how_well(model, offsets):
    found = [estimate_offset(*marked(seed, offset, model=model, share=0.6)) for seed, offset in enumerate(offsets)]
    errors = np.array([one.offset_ns - offset for one, offset in zip(found, offsets, strict=True)])
    sigmas = np.array([one.sigma_ns for one in found])
    assert np.sqrt(np.mean(errors**2)) < 2.0 * MS
    assert (np.abs(errors) < 3.0 * sigmas).all()
    assert (sigmas < 1.6 * MS).all()
    assert all(1.2 < one.rms_px < 1.7 for one in found)  # 1 px per coordinate, and the vertices


def test_blunders_are_left_out():
    track, stamps, pixels, request = marked(4, 25 * MS, wrong=0.05)
    found = estimate_offset(track, stamps, pixels, request)
    assert abs(found.offset_ns - 25 * MS) < 3 * found.sigma_ns < 7 * MS
    assert 0.02 * len(pixels) < found.blunders < 0.07 * len(pixels)
    assert found.pairs + found.blunders + found.unseen == len(pixels)
    assert found.rms_px < 1.7


def test_fewer_marks_are_told_to_tell_less_and_the_estimate_survives_json():
    track, stamps, pixels, request = marked(5, 10 * MS)
    some = estimate_offset(track, stamps[::4], pixels[::4], request)
    all_of_them = estimate_offset(track, stamps, pixels, request)
    assert some.sigma_ns == pytest.approx(2.0 * all_of_them.sigma_ns, rel=0.4)
    assert abs(some.offset_ns - 10 * MS) < 3 * some.sigma_ns
    document = json.loads(json.dumps(asdict(some)))
    assert document["offset_ns"] == some.offset_ns
    assert f"{abs(some.offset_ns) / 1e6:.1f} ms" in document["message"]


def test_a_known_camera_needs_fewer_marks():
    track, stamps, pixels, request = marked(6, -30 * MS)
    lens = make_camera("brown_conrady", 6).intrinsics
    with pytest.raises(SolveError):
        estimate_offset(track, stamps[:12], pixels[:12], request)
    known = request | {"locked": dict(lens)}
    found = estimate_offset(track, stamps[::20], pixels[::20], known)
    assert abs(found.offset_ns + 30 * MS) < 3 * found.sigma_ns


def test_clocks_that_are_far_apart_are_searched_about_what_is_known():
    track, stamps, pixels, request = marked(7, 20 * MS)
    stamps, pixels = stamps[::2], pixels[::2]
    day = 86_400_000_000_000
    found = estimate_offset(track, stamps + day, pixels, request, about_ns=day + 50 * MS)
    here = estimate_offset(track, stamps, pixels, request, about_ns=50 * MS)
    assert found.offset_ns - day == pytest.approx(here.offset_ns, abs=100)
    assert abs(here.offset_ns - 20 * MS) < 3 * here.sigma_ns


def test_a_mount_that_nobody_knows_is_searched():
    track, stamps, pixels, request = marked(8, 35 * MS, model="pinhole")
    anywhere = SE3(CAMERA_FRAME, LIDAR_FRAME, rotation_from_euler(np.radians((200.0, 20.0, 70.0))), np.zeros(3))
    request |= {"nominal": to_document(anywhere), "rotation_range_deg": 180.0}
    found = estimate_offset(track, stamps[::2], pixels[::2], request)
    assert abs(found.offset_ns - 35 * MS) < 3 * found.sigma_ns < 8 * MS


def refusal(*given, **named):
    with pytest.raises(InputError) as caught:
        estimate_offset(*given, **named)
    assert caught.value.code == "offset_not_determined"
    assert caught.value.hint
    return caught.value.message


def test_what_tells_no_offset_is_refused():
    assert "px/s" in refusal(*marked(1, 20 * MS, plan="still")), "who stands still tells nothing"
    assert "end of the searched range" in refusal(*marked(2, 230 * MS)), "none is made up"
    track, stamps, pixels, request = marked(3, 0)
    of_something_else = np.random.default_rng(0).uniform((0, 0), (960, 600), pixels.shape)
    assert "No camera" in refusal(track, stamps, of_something_else, request)


def test_marks_without_vertices_nearby_are_counted_out():
    track, stamps, pixels, request = marked(4, 15 * MS)
    stamps, pixels = stamps[::5], pixels[::5]
    later = np.concatenate([stamps, stamps[:30] + 70_000 * MS])
    found = estimate_offset(track, later, np.concatenate([pixels, pixels[:30]]), request)
    assert found.unseen == 30
    assert abs(found.offset_ns - 15 * MS) < 3 * found.sigma_ns
    assert "near a corner" in refusal(track, stamps + 70_000 * MS, pixels, request)


def test_a_fit_that_does_not_converge_is_refused(monkeypatch):
    track, stamps, pixels, request = marked(4, 25 * MS)
    monkeypatch.setattr(offset_fit, "_MOST_STEPS", 1)
    monkeypatch.setattr(offset_fit, "_TOLERANCE", 0.0)
    with pytest.raises(InputError, match="did not converge: The steps ran out"):
        estimate_offset(track, stamps[::8], pixels[::8], request)


def test_marks_that_are_worse_than_stated_widen_the_deviation():
    """Residuals three times as large as what pixel and track explain: so is the stated deviation."""
    track, stamps, pixels, request = marked(9, 15 * MS)
    sound = estimate_offset(track, stamps, pixels, request)
    noise = np.random.default_rng(10).normal(size=pixels.shape)
    poor = estimate_offset(track, stamps, pixels + 4.0 * noise, request)
    # Left over are the noise of the marks and that of the track, each as large as before.
    assert poor.sigma_ns / sound.sigma_ns == pytest.approx(poor.rms_px / sound.rms_px, rel=0.2)
    assert poor.rms_px > 2.5 * sound.rms_px
