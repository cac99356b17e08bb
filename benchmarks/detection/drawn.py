"""Walks and streets whose sensor, scene, person and board are drawn (`tests.support.scenes.drawn`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from apexcal.documents.readings import ReadOptions
from benchmarks.detection.figures import figures, mean_sigma
from benchmarks.detection.real import DATA
from benchmarks.detection.walks import Found, found, looked_at
from tests.support.scenes.drawn import draw, draw_street
from workers.readers.detect import open_recording
from workers.simulation.scene import WALKER_REGION
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

STREET_SWEEPS = 5
# A short recording gives no upper corner. In this one people walk away, and what stands still is told.
LEVEL_SWEEPS, LEVEL_PERIOD_S = 24, 0.3
ROAD = DATA / "road-lane-markers"
_FEW = 20  # vertices of a walk, below which its bias says nothing


@dataclass(frozen=True, slots=True)
class DrawnWalk:
    """One drawn walk, and what was found in it."""

    seed: int
    about: str
    found: Found


def run_drawn(asked: tuple[int, float, int]) -> DrawnWalk:
    """Simulate the drawn walk of a seed, so many seconds long, and look for its board, whose size is known.

    The third number is the detector's ``upper_corner``; if it is not 0, the board is held level but for a drawn roll.
    """
    seed, seconds, upper = asked
    drawn = draw(seed)
    if upper:
        off = float(np.clip(np.random.default_rng([seed, 79]).normal(0.0, 6.0), -15.0, 15.0))
        drawn = replace(drawn, hold=replace(drawn.hold, rolled_deg=45.0 * upper + off))
    walked = looked_at(*drawn.simulated(seconds), seconds)
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1], "upper_corner": upper}
    seen = found("drawn", "refined", walked, Region.from_document(drawn.region()), "refined", size)
    hold, mount, person = drawn.hold, drawn.mount, drawn.disturbances
    about = (
        f"{drawn.sensor.name} {drawn.sensor.rate_hz:g} Hz, {drawn.plan}, board {size['board_width_m']:.2f} x "
        f"{size['board_height_m']:.2f} m rolled {hold.rolled_deg:+.0f} tilted {hold.tilted_deg:+.0f}, body "
        f"{hold.body_behind_m:.2f} m, mount {mount.roll_deg:+.0f} {mount.pitch_deg:+.0f}, seam {mount.seam_deg:.0f}, "
        f"noise {1e3 * drawn.noise_m:.0f} mm, beam {person.beam_mrad:.1f} mrad, second {person.second_person}"
        + (", head" if person.head_above_m > 0.0 else "")
    )
    return DrawnWalk(seed, about, seen)


def drawn_figures(walks: Sequence[DrawnWalk]) -> dict[str, Any]:
    """All drawn walks together, and each by itself.

    ``worst_bias_deg`` is of azimuth and elevation. ``bias_sigma_deg`` is the standard error of a walk's mean: what is
    not well above it, the walk is too short to tell.
    """
    whole = figures([walk.found for walk in walks])
    each = [{"seed": walk.seed, "about": walk.about, **_each(walk.found)} for walk in walks]
    told = [walk["bias_deg"] for walk in each if walk["vertices"] >= _FEW]
    rejected: dict[str, int] = {}
    for walk in walks:
        for reason, count in walk.found.rejected.items():
            rejected[reason] = rejected.get(reason, 0) + count
    return whole | {
        "worst_bias_deg": max(told, default=0.0),
        "walks_within_0.015_deg": float(np.mean([bias <= 0.015 for bias in told])) if told else 0.0,
        "rejected": rejected,
        "each": each,
    }


def _each(seen: Found) -> dict[str, Any]:
    own = figures([seen])
    axis = int(abs(own.get("bias_deg", 0.0)) > abs(own.get("bias_azimuth_deg", 0.0)))
    return {
        "vertices": len(seen.vertices),
        "share": own["accepted_share"],
        "gross": own.get("gross_share", 0.0),
        "coverage": own.get("coverage_2sigma", 0.0),
        "bias_deg": max(abs(own.get("bias_deg", 0.0)), abs(own.get("bias_azimuth_deg", 0.0))),
        "bias_sigma_deg": mean_sigma(seen.vertices[:, axis]),
        "rejected": dict(seen.rejected),
    }


def run_street(asked: tuple[int, int]) -> int:
    """How many sweeps of a drawn street without a board give a vertex.

    Args:
        asked: the seed, and the detector's ``upper_corner``. If that is not 0, the sweeps are `LEVEL_PERIOD_S` apart.
    """
    seed, upper = asked
    drawn = draw_street(seed)
    period_s, count = (LEVEL_PERIOD_S, LEVEL_SWEEPS) if upper else (1.0 / drawn.sensor.rate_hz, STREET_SWEEPS)
    _, lidar = drawn.simulated(period_s * count + 1.0 if upper else 1.0)
    sweeps = [lidar.sweep(k, k * period_s, round(k * period_s * 1e9)) for k in range(count)]
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1], "upper_corner": upper}
    region = Region.from_document(drawn.region())
    return len(detect_range(Listed(sweeps), region, "refined", size, indices=range(len(sweeps))).vertices)


def road_vertices() -> int | None:
    """How many vertices the recorded road frame gives, which has no board; None where it is absent."""
    if not ROAD.exists():
        return None
    recording = open_recording(ROAD, ReadOptions(point_times="stamp_only"))
    try:
        (lidar,) = (sensor for sensor in recording.sensors if sensor.kind == "lidar")
        source = Listed(list(recording.sweeps(lidar)))
    finally:
        recording.close()
    region = Region.from_document(WALKER_REGION)
    return len(detect_range(source, region, "refined", {}, indices=range(len(source))).vertices)
