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
from tests.support.places import FRONTEND
from workers.readers.normalised.packed_sweeps import pack, unpacked
from workers.readers.recording import Sweep

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
        time_source="per_point",
    )


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_every_point_comes_back(count):
    sweep = sweep_of(count)
    data = pack(sweep, RINGS)
    header, xyz, ring, intensity, offset_ns = unpack(data)
    order = np.argsort(sweep.ring, kind="stable")
    assert header == SweepHeader(RINGS, count)
    # Half a step, and what single precision rounds at 100 m.
    np.testing.assert_allclose(xyz, sweep.xyz[order], rtol=0, atol=0.00005 + 8e-6)
    assert np.array_equal(ring, sweep.ring[order])
    assert np.array_equal(intensity, sweep.intensity[order])
    np.testing.assert_allclose(offset_ns, sweep.offset_ns[order], rtol=0, atol=500)
    again = unpacked(data, count, STAMP_NS, sweep.time_source)
    assert again.stamp_ns == STAMP_NS
    for name in ("xyz", "ring", "intensity", "offset_ns"):
        column = getattr(again, name)
        assert column.flags.c_contiguous and column.dtype == getattr(sweep, name).dtype
        assert np.array_equal(column, getattr(unpack(data), name))


def test_what_lies_far_away_has_a_coarser_step_and_what_no_sensor_measures_is_cut_off():
    """Neighbours at both ends of the range: differences of positions wrap round."""
    sweep = sweep_of(6)
    sweep.ring[:] = 0
    sweep.intensity[:] = [np.nan, np.inf, -5.0, 0.25, 1.0, 0.5]
    for reach, step, expected in ((838.0, 1e-4, 838.0), (839.0, 1e-3, 839.0), (1e30, 1e-3, 8388.607)):
        sweep.xyz[:, 0] = [reach, -reach, 8.0, -reach, 7.0, 0.0]
        header, xyz, _, intensity, _ = unpack(pack(sweep, RINGS))
        assert header.position_step_m == step
        assert xyz[:, 0].tolist() == pytest.approx([expected, -expected, 8.0, -expected, 7.0, 0.0], abs=step / 2)
        assert intensity.tolist() == pytest.approx([0, 0, 0, 0.25, 1.0, 0.5], abs=1e-5)


def test_a_point_of_another_time_is_refused_and_one_of_another_ring_is_not():
    sweep = sweep_of(6)
    sweep.ring[3] = RINGS + 4
    assert unpack(pack(sweep, RINGS)).ring.tolist() == [0, 1, 2, 4, 5, RINGS + 4]
    sweep.offset_ns[2] = 8_400_000_000
    with pytest.raises(OverflowError):
        pack(sweep, RINGS)


def test_bytes_that_are_no_sweep_are_refused():
    data = pack(sweep_of(100), RINGS)
    body = gzip.decompress(data)
    lists_more = body[:8] + (101).to_bytes(4, "little") + body[12:]
    rings_differ = body[:36] + (99).to_bytes(4, "little") + body[40:]
    for wrong in (b"", body[:20], b"APXS\x01\x00" + body[6:], body[:-1], lists_more, rings_differ):
        with pytest.raises(ValueError, match="sweep"):
            unpack(gzip.compress(wrong))
    for wrong in (b"", data[:50], bytes(200), gzip.compress(body + bytes(10**6))):
        with pytest.raises(ValueError, match=r".+"):
            unpacked(wrong, 100, 0, "per_point")


def test_the_layout_is_the_documented_one():
    """Byte by byte, as docs/api.md says it: two points on ring 1."""
    sweep = sweep_of(2)
    sweep.xyz[:] = [[0.1, -0.0001, 0.0], [0.1002, -0.0003, 7.0]]
    sweep.ring[:] = 1
    sweep.intensity[:] = [258, 3]
    sweep.offset_ns[:] = [0, -2000]
    body = gzip.decompress(pack(sweep, 2))
    assert body[:8] == b"APXS" + (2).to_bytes(2, "little") + (2).to_bytes(2, "little")
    assert len(body) == HEADER_BYTES + 2 * 4 + 2 * BYTES_PER_POINT and HEADER_BYTES == 36
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
    data = pack(sweep, RINGS)
    (tmp_path / "sweep").write_bytes(data)
    script = f"""
        import {{ readFileSync }} from "node:fs";
        import {{ unpack }} from "./src/lib/points/sweep.ts";
        const sweep = await unpack(new Uint8Array(readFileSync({json.dumps(str(tmp_path / "sweep"))})));
        const columns = ["positions", "rings", "intensities", "timesNs"].map((name) => [name, [...sweep[name]]]);
        console.log(JSON.stringify(Object.fromEntries(columns)));
    """
    said = subprocess.run(
        [node, "--input-type=module-typescript", "-e", script], cwd=FRONTEND, capture_output=True, check=True
    )
    read = json.loads(said.stdout)
    points = unpack(data)
    assert np.array(read["positions"]).reshape(-1, 3) == pytest.approx(points.xyz, abs=3e-4)  # at 8 km
    assert read["rings"] == points.ring.tolist()
    assert read["intensities"] == points.intensity.tolist()
    assert read["timesNs"] == points.offset_ns.tolist()


def test_a_position_that_is_none_becomes_the_origin_and_moves_no_other():
    sweep = sweep_of(100)
    sweep.xyz[[3, 50]] = [[np.nan, 1.0, 2.0], [np.inf, -np.inf, 0.0]]
    order = np.argsort(sweep.ring, kind="stable")
    _, xyz, *_ = unpack(pack(sweep, RINGS))
    expected = np.nan_to_num(sweep.xyz[order], nan=0.0, posinf=0.0, neginf=0.0)
    assert np.abs(xyz - expected).max() <= 0.00005 + 8e-6
