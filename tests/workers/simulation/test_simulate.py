"""A seed decides every byte, and progress counts."""

import hashlib

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.simulate import simulate


def test_a_seed_decides_every_byte(tmp_path):
    def digests(name, seed):
        files = simulate(SimulationOptions(seconds=1.0, seed=seed, camera_hz=2.0), tmp_path / name)
        return [hashlib.sha256(file.read_bytes()).hexdigest() for file in (files.recording, files.truth, files.rig)]

    first, again, other = digests("first", 8), digests("again", 8), digests("other", 9)
    assert first == again
    assert first[0] != other[0] and first[1] != other[1]


def test_progress_counts_to_its_end(short):
    total = short.files.sweeps + short.files.frames
    expected = [("background", 0, 1), ("background", 1, 1)]
    assert short.progress == expected + [("recording", done, total) for done in range(1, total + 1)]
