"""Pairs of a walk as a detector would leave them, without rendering: places of the board's tip, and their errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from apexcal.geometry.se3 import to_document
from benchmarks.coverage.walks import Paired, Walked
from workers.geometry.models import ModelName
from workers.geometry.spherical import axes
from workers.simulation.camera import FRONT, SimulatedCamera, make_camera, nominal_mount
from workers.simulation.rig import SimulatedRig

Floats = NDArray[np.float64]
# A vertex across its ray: the board's edges are known to millimetres, and a beam has a width (SPEC: medians of 6.6
# to 14 mm on real recordings).
_ACROSS_M: Final = (0.003, 0.006)
_ACROSS_RAD: Final = (0.0002, 0.0006)
_RANGE_M: Final = (0.004, 0.010)
# Of a walk's vertices 0.1 s apart 0.94 of the azimuth's error is common (SPEC, third look); half of it all here.
_LAG: Final = 0.94
_LASTING: Final = 0.5
_SWEEP_NS: Final = 100_000_000
_REACH: Final = 5  # sweeps
_TRACK_M: Final = 0.007  # a vertex's own error, per coordinate (SPEC: 6.6 to 14 mm)
CLOCK_SIGMA_MS: Final = 1.5
"""What an estimated clock offset is good to (SPEC: 1.0 to 1.2 ms)."""


def draw_pairs(
    seed: int,
    lens: ModelName,
    decentring: float = 0.0,
    late_ms: float = 0.0,
    lasting: float = _LASTING,
    pairs: tuple[int, int] = (200, 260),
    heights_m: float = np.inf,
) -> Paired:
    """Draw a rig, its camera, a walk of two to three minutes, and pairs of it.

    decentring: deviation of the tangential terms of a `brown_conrady` lens; late_ms: of the frames beyond what the
    clocks' estimated offset misses; lasting: share of the vertices' variance that lasts; pairs: the fewest and the
    most; heights_m: within which the tips lie.
    """
    random = np.random.default_rng([seed, 61])
    settings = SimulationOptions(
        seconds=float(random.uniform(120.0, 180.0)),
        seed=seed,
        walk="rows",
        pitch_down_deg=float(random.uniform(6.0, 16.0)),
        camera_model=lens,
    )
    rig = SimulatedRig(settings)
    camera = _camera(rig, lens, random, decentring)
    frames = rig.cameras[0].times_ns
    walked = Walked(rig)
    apex = walked.poses(frames).apex
    is_low = np.abs(apex[:, 2] - np.median(apex[:, 2])) <= 0.5 * heights_m
    seen = np.flatnonzero(_inside(camera, camera.project(apex)) & is_low)
    count = min(int(random.integers(pairs[0], pairs[1] + 1)), len(seen))
    taken = seen[np.round(np.linspace(0, len(seen) - 1, count)).astype(np.int64)]
    off_ns = np.int64(round(1e6 * (late_ms + random.normal(0.0, CLOCK_SIGMA_MS))))
    stamps = frames[taken] + off_ns  # where the vertices are said to be at the frames' moments
    apex = walked.poses(stamps).apex
    sigmas, noise = _errors(apex, stamps, random, lasting)
    return Paired(
        walked,
        camera,
        to_document(nominal_mount(FRONT, 0.0, settings.pitch_down_deg)),
        apex + np.einsum("nij,nj->ni", axes(apex), noise),
        sigmas,
        frames[taken],
        stamps,
        taken,
        taken,
        np.zeros(count, np.int64),
        np.arange(count),
    )


def track_velocities(paired: Paired, random: np.random.Generator) -> Floats:
    """(N, 3) m/s: slopes of the detection's track, a vertex at each sweep within half a second of the pair."""
    steps = np.arange(-_REACH, _REACH + 1)
    places = np.stack([paired.places(paired.stamps_ns + step * _SWEEP_NS) for step in steps])
    places = places + random.normal(0.0, _TRACK_M, places.shape)
    seconds = 1e-9 * _SWEEP_NS * steps
    return np.tensordot(seconds, places, axes=1) / float(np.sum(seconds**2))


def _camera(rig: SimulatedRig, lens: ModelName, random: np.random.Generator, decentring: float) -> SimulatedCamera:
    """A camera of the rig with 960 x 600 or 1920 x 1200 pixels, its focal length and centre as lenses vary."""
    camera = make_camera(lens, rig.options.seed, rig.cameras[0].own.T_camera_lidar)
    times, scale = int(random.integers(1, 3)), float(random.uniform(0.95, 1.15))
    k = dict(camera.intrinsics)
    k |= {name: k[name] * times * scale for name in ("f_x", "f_y")}
    k |= {name: (k[name] + 0.5 + random.normal(0.0, 6.0)) * times - 0.5 for name in ("c_x", "c_y")}
    if lens == "brown_conrady" and decentring:
        k |= {name: float(random.normal(0.0, decentring)) for name in ("k3", "k4")}
    width, height = camera.image_size
    return replace(camera, intrinsics=k, image_size=(width * times, height * times))


def _inside(camera: SimulatedCamera, pixels: Floats) -> NDArray[np.bool_]:
    """People mark what they see well inside of the image."""
    return camera.sees(pixels) & camera.sees(pixels + 4.0) & camera.sees(pixels - 4.0)


def _errors(
    apex: Floats, stamps: NDArray[np.int64], random: np.random.Generator, lasting: float
) -> tuple[Floats, Floats]:
    """Stated deviations (N, 3) of azimuth, elevation (rad) and range (m), and errors of that size, alike in time."""
    distance = np.linalg.norm(apex, axis=1)
    across = np.hypot(random.uniform(*_ACROSS_M) / distance, random.uniform(*_ACROSS_RAD))
    sigmas = np.column_stack([across, across, np.full(len(apex), random.uniform(*_RANGE_M))])
    alike = np.zeros_like(sigmas)
    alike[0] = random.normal(size=3)
    rho = _LAG ** (np.abs(np.diff(stamps)) / _SWEEP_NS)
    for i in range(1, len(apex)):
        alike[i] = rho[i - 1] * alike[i - 1] + np.sqrt(1.0 - rho[i - 1] ** 2) * random.normal(size=3)
    own = random.normal(size=sigmas.shape)
    return sigmas, sigmas * (np.sqrt(lasting) * alike + np.sqrt(1.0 - lasting) * own)
