import hashlib
from dataclasses import replace

import pytest

from workers.simulation.simulate import Settings, simulate


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_seed_decides_every_byte(tmp_path):
    settings = Settings(seconds=1.0, seed=8)
    first = simulate(settings, tmp_path / "first")
    again = simulate(settings, tmp_path / "again")
    other = simulate(replace(settings, seed=9), tmp_path / "other")
    for name in ("recording", "truth", "rig"):
        assert digest(getattr(first, name)) == digest(getattr(again, name))
    assert digest(first.recording) != digest(other.recording)
    assert digest(first.truth) != digest(other.truth)


def test_progress_counts_to_its_end(short):
    stages = [stage for stage, _, _ in short.progress]
    assert stages[:2] == ["background", "background"]
    total = short.written.sweeps + short.written.frames
    recording = [(done, of) for stage, done, of in short.progress if stage == "recording"]
    assert recording == [(done, total) for done in range(1, total + 1)]


def test_the_rig_names_what_the_recording_holds(short):
    description = short.description
    assert description["lidar"]["topic"] == "/velodyne_points"
    [camera] = description["cameras"]
    assert camera["image_size"] == [960, 600]
    assert short.truth["intrinsics"]["image_size"] == [960, 600]
    assert short.truth["intrinsics"]["model"] == "brown_conrady"
    assert short.truth["settings"]["seed"] == 3


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"seed": -1}, "seed"),
        ({"sensor": "vlp17"}, "sensor"),
        ({"rings": 2}, "rings"),
        ({"sector_deg": 181.0}, "sector_deg"),
        ({"range_noise_mm": -1.0}, "range_noise_mm"),
    ],
)
def test_settings_that_cannot_be_simulated_are_refused(change, word):
    with pytest.raises(ValueError, match=word):
        Settings(**change)
