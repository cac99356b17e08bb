"""A packed sweep holds every point, read back here and by the pages' own reader."""

import gzip
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from apexcal.documents.sweeps import BYTES_PER_POINT, HEADER_BYTES, SweepHeader
from apexcal.sweeps import unpack
from workers.readers.normalised.packed_sweeps import pack
from workers.readers.recording import Sweep

FRONTEND = Path(__file__).parents[4] / "frontend"
STAMP_NS = 1_700_000_000_123_456_789
RINGS = 16


def sweep_of(count: int, seed: int = 1) -> Sweep:
    """Points out to 100 m in the order of their firing: ring after ring, again and again."""
    rng = np.random.default_rng(seed)
    ring = np.arange(count) % RINGS
    azimuth = 2 * np.pi * np.arange(count) / max(count, 1)
    distance = 40 + 30 * np.sin(7 * azimuth) + rng.normal(0, 0.02, count)
    elevation = np.radians(-15 + 2 * ring)
    flat = distance * np.cos(elevation)
    xyz = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)])
    return Sweep(
        stamp_ns=STAMP_NS,
        xyz=xyz.astype(np.float32),
        intensity=rng.integers(0, 256, count).astype(np.float32),
        ring=ring.astype(np.uint16),
        offset_ns=np.linspace(-5e7, 5e7, count).astype(np.int64),
        time_source="measured",
    )


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_every_point_comes_back(count):
    sweep = sweep_of(count)
    header, xyz, ring, intensity, time_ns = unpack(pack(sweep, 7, RINGS))
    order = np.argsort(sweep.ring, kind="stable")
    assert header == SweepHeader(RINGS, count, 7, STAMP_NS)
    np.testing.assert_allclose(xyz, sweep.xyz[order], rtol=0, atol=0.0005 + 1e-9)
    assert np.array_equal(ring, sweep.ring[order])
    assert np.array_equal(intensity, sweep.intensity[order])
    np.testing.assert_allclose(time_ns - STAMP_NS, sweep.offset_ns[order], rtol=0, atol=500)


def test_what_no_sensor_measures_is_cut_off_and_kept_apart():
    """Neighbours at both ends of the range: differences of positions wrap round."""
    sweep = sweep_of(6)
    sweep.xyz[:, 0] = [1e30, -1e30, 8388.0, -8388.0, 8388.0, 0.0]
    sweep.ring[:] = 0
    sweep.intensity[:] = [np.nan, np.inf, -5.0, 0.25, 1.0, 0.5]
    _, xyz, _, intensity, _ = unpack(pack(sweep, 0, RINGS))
    assert xyz[:, 0].tolist() == pytest.approx([8388.607, -8388.607, 8388.0, -8388.0, 8388.0, 0.0])
    assert intensity.tolist() == pytest.approx([0, 0, 0, 0.25, 1.0, 0.5], abs=1 / 255)


def test_the_layout_is_the_documented_one():
    """Byte by byte, as docs/api.md says it: two points on ring 1."""
    sweep = sweep_of(2)
    sweep.xyz[:] = [[1.0, -0.001, 0.0], [1.002, -0.003, 70.0]]
    sweep.ring[:] = 1
    sweep.intensity[:] = [258, 3]
    sweep.offset_ns[:] = [0, -2000]
    body = gzip.decompress(pack(sweep, 3, 2))
    assert body[:8] == b"APXS" + (1).to_bytes(2, "little") + (2).to_bytes(2, "little")
    assert len(body) == HEADER_BYTES + 2 * 4 + 2 * BYTES_PER_POINT and HEADER_BYTES == 48
    columns = body[HEADER_BYTES + 8 :]
    folded = 2 * 70_000
    assert list(columns[:6]) == [2000 % 256, 4, 2000 // 256, 0, 0, 0]  # x: 1000 and 2 more
    assert list(columns[6:12]) == [1, 3, 0, 0, 0, 0]  # y: -1 and 2 less
    assert list(columns[12:18]) == [0, folded % 256, 0, folded // 256 % 256, 0, folded // 65536]
    assert list(columns[18:22]) == [2, 3, 1, 0]  # intensity
    assert list(columns[22:]) == [0, 3, 0, 0, 0, 0]  # time: 0 and 2 less


def test_the_pages_read_the_same_points(tmp_path):
    node = Path(sys.executable).parent / "node"
    sweep = sweep_of(3000)
    sweep.xyz[5, 0], sweep.xyz[5 + RINGS, 0] = 8388.0, -8388.0
    data = pack(sweep, 7, RINGS)
    (tmp_path / "sweep").write_bytes(data)
    script = f"""
        import {{ readFileSync }} from "node:fs";
        import {{ unpack }} from "./src/lib/points/sweep.ts";
        const sweep = await unpack(new Uint8Array(readFileSync({json.dumps(str(tmp_path / "sweep"))})));
        const columns = ["positions", "rings", "intensities", "timesNs"].map((name) => [name, [...sweep[name]]]);
        const head = {{ index: sweep.index, stamp: String(sweep.stampNs) }};
        console.log(JSON.stringify({{ ...Object.fromEntries(columns), ...head }}));
    """
    said = subprocess.run(
        [node, "--input-type=module-typescript", "-e", script], cwd=FRONTEND, capture_output=True, check=True
    )
    read = json.loads(said.stdout)
    points = unpack(data)
    assert (read["index"], read["stamp"]) == (7, str(STAMP_NS))
    assert np.array(read["positions"]).reshape(-1, 3) == pytest.approx(points.xyz, abs=3e-4)  # single precision
    assert read["rings"] == points.ring.tolist()
    assert read["intensities"] == points.intensity.tolist()
    assert read["timesNs"] == (points.time_ns - STAMP_NS).tolist()


def test_a_position_that_is_none_becomes_the_origin_and_moves_no_other():
    sweep = sweep_of(100)
    sweep.xyz[[3, 50]] = [[np.nan, 1.0, 2.0], [np.inf, -np.inf, 0.0]]
    order = np.argsort(sweep.ring, kind="stable")
    _, xyz, *_ = unpack(pack(sweep, 0, RINGS))
    expected = np.nan_to_num(sweep.xyz[order], nan=0.0, posinf=0.0, neginf=0.0)
    assert np.abs(xyz - expected).max() <= 0.0005 + 1e-9
