"""Simulated walks with the refined detector's vertices, paired with a camera's frames at the estimated offset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.fit_requests import fit_request
from apexcal.documents.simulation import SimulationOptions
from apexcal.geometry.se3 import to_document
from workers.geometry.models import ModelName
from workers.simulation.camera import FRONT, SimulatedCamera, make_camera, nominal_mount
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.scene import WALKER_REGION
from workers.simulation.walker import BOARD_EDGES_M, Poses
from workers.solver.clock_offset import OffsetEstimate, estimate_offset
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import pair_interpolated
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed
from workers.vertices.tracks import Track
from workers.vertices.vertex import Vertex

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SECONDS: Final = 60.0
PAIRS: Final = 222
CORNERS: Final = 4  # of the board: the apex, those beside it, and the one below
_A_POSE: Final = 4
_CLOCK_MS: Final = 30.0
_MAX_GAP_NS: Final = 50_000_000
_BOARD: Final = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}


@dataclass(frozen=True, eq=False)
class Walked:
    """A walk and the vertices that were found in it."""

    rig: SimulatedRig
    vertices: list[Vertex]

    def poses(self, times_ns: Integers) -> Poses:
        """Board and people at moments of the LiDAR's clock."""
        return self.rig.walk.poses((times_ns - START_NS).astype(np.float64) * 1e-9)


@dataclass(frozen=True, eq=False)
class Paired:
    """N vertices moved to the moments of their frames.

    ``xyz`` metres, ``sigmas`` (N, 3) of azimuth, elevation (rad) and range (m), ``taken_ns`` when the frames were
    truly taken by the LiDAR's clock, ``stamps_ns`` of the vertices, ``sweeps`` and ``frames`` their numbers.
    ``corner``: which of the board's is marked, 0 the apex. ``pose``: pairs of one number share a pose's errors.
    """

    walked: Walked
    camera: SimulatedCamera
    nominal: dict[str, object]
    xyz: Floats
    sigmas: Floats
    taken_ns: Integers
    stamps_ns: Integers
    sweeps: Integers
    frames: Integers
    corner: Integers
    pose: Integers

    @property
    def is_still(self) -> bool:
        """Whether the board stood still in each pose, and all its corners are marked."""
        return bool(np.any(self.corner))

    def places(self, times_ns: Integers) -> Floats:
        """(N, 3) where the marked corners truly are at these moments, metres, LiDAR frame."""
        poses = self.walked.poses(times_ns)
        left, right = (
            edge * way for edge, way in zip(poses.board_m, (poses.edge_left, poses.edge_right), strict=True)
        )
        beside = np.stack([np.zeros_like(left), left, right, left + right])
        return poses.apex + beside[self.corner, np.arange(len(self.corner))]


def walk(seed: int) -> Walked:
    """Simulate a walk and look for vertices in it."""
    rig = SimulatedRig(SimulationOptions(seconds=SECONDS, seed=seed, walk="rows", clock_offset_ms=_CLOCK_MS))
    sweeps = list(rig.sweeps())
    region = Region.from_document(WALKER_REGION)
    found = detect_range(Listed(sweeps), region, "refined", _BOARD, indices=range(len(sweeps)))
    return Walked(rig, found.vertices)


def pair(walked: Walked, model: ModelName, wrong_ms: float = 0.0, finer: int = 1) -> Paired:
    """The pairs of a camera with that lens, at the clock offset that marks of 1 px give, plus ``wrong_ms``.

    ``finer``: how many pixels for each of the simulated camera's, along each axis.
    """
    camera = _finer(make_camera(model, walked.rig.options.seed), finer)
    about = pair_at(walked, camera, round(_CLOCK_MS * 1e6))
    random = np.random.default_rng([walked.rig.options.seed, 31])
    seen = camera.project(walked.poses(about.taken_ns).apex)
    offset = offset_of(about, seen + random.normal(0.0, 1.0, seen.shape))
    return pair_at(walked, camera, offset.offset_ns + round(1e6 * wrong_ms))


def _finer(camera: SimulatedCamera, times: int) -> SimulatedCamera:
    lens = dict(camera.intrinsics)
    lens |= {name: lens[name] * times for name in ("f_x", "f_y")}
    # The centre of the top-left pixel is at (0, 0).
    lens |= {name: (lens[name] + 0.5) * times - 0.5 for name in ("c_x", "c_y")}
    width, height = camera.image_size
    return replace(camera, intrinsics=lens, image_size=(width * times, height * times))


def offset_of(paired: Paired, marks: Floats) -> OffsetEstimate:
    """The clocks' offset that marks (N, 2) of the pairs' frames tell."""
    camera = paired.camera
    request = {"model": camera.model, "image_size": list(camera.image_size), "nominal": paired.nominal}
    stamps = paired.walked.rig.cameras[0].stamps_ns[paired.frames]
    return estimate_offset(Track.of(paired.walked.vertices), stamps, marks, fit_request(**request, mark_sigma_px=1.0))


def pair_at(walked: Walked, camera: SimulatedCamera, offset_ns: int) -> Paired:
    """The pairs of a camera at an offset of its clock."""
    mounted = walked.rig.cameras[0]
    moved = pair_interpolated(walked.vertices, mounted.stamps_ns, offset_ns=offset_ns, max_gap_ns=_MAX_GAP_NS)
    paired = np.flatnonzero(moved.index >= 0)
    _, first = np.unique(moved.index[paired], return_index=True)
    usable = np.sort(paired[first])
    taken = mounted.times_ns[moved.index[usable]]
    usable = usable[camera.sees(camera.project(walked.poses(taken).apex))]
    if len(usable) > PAIRS:
        usable = usable[np.round(np.linspace(0, len(usable) - 1, PAIRS)).astype(np.int64)]
    frames = moved.index[usable]
    return Paired(
        walked,
        camera,
        to_document(nominal_mount(FRONT)),
        moved.xyz[usable],
        np.sqrt(np.diagonal(moved.covariance[usable], axis1=1, axis2=2)),
        mounted.times_ns[frames],
        np.array([walked.vertices[index].time_ns for index in usable], np.int64),
        np.array([walked.vertices[index].sweep_index for index in usable], np.int64),
        frames,
        np.zeros(len(frames), np.int64),
        np.arange(len(frames)) // _A_POSE,
    )
