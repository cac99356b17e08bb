"""Walks past the thermal camera of `apexcal simulate`, whose 16 bits the machine marks.

Vertices err as a detector states; mount and frames are the simulator's. The lens is stated in four of five scenes.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import Counter
from typing import Final, NamedTuple

import numpy as np

from apexcal.documents.simulation import SimulationOptions
from benchmarks.marks.figures import quantiles, share
from workers.geometry.models import INTRINSICS
from workers.geometry.spherical import to_xyz
from workers.marks.propose import propose
from workers.marks.sights import Floats, Image, Lens, MarkProposal, Sight
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.simulate import film_of
from workers.simulation.thermal import ThermalCamera

SCENES: Final = 20
_FRAMES: Final = 40
_SECONDS: Final = 60.0
_NEAR_PX: Final = 20.0  # of a short side: as for other scenes
_DEVIATIONS: Final = np.array([np.radians(0.04), np.radians(0.04), 0.01])


class ThermalOutcome(NamedTuple):
    """A scene's contrast (K), blur (px), visible tips, errors of its marks (px), and why others have none."""

    contrast_k: float
    blur_px: float
    visible: int
    errors_px: list[float]
    refused: Counter[str]
    failure: str


def run_thermal(seed: int) -> ThermalOutcome:
    """Mark the frames of a walk that show the board."""
    rig = SimulatedRig(SimulationOptions(seconds=_SECONDS, seed=seed, images="thermal", walk="yard"))
    mounted, random = rig.cameras[0], np.random.default_rng([seed, 44])
    poses = rig.walk.poses((mounted.times_ns - START_NS).astype(np.float64) * 1e-9)
    paint = film_of(rig, mounted)
    tips = mounted.camera.project(poses.apex)
    left, right = poses.board_m[0] * poses.edge_left, poses.board_m[1] * poses.edge_right
    side = np.hypot(*(mounted.camera.project(poses.apex + left) - tips).T)
    shown = np.flatnonzero(mounted.camera.sees(tips - 10.0) & mounted.camera.sees(tips + 10.0) & (side > _NEAR_PX))
    chosen = shown[np.unique(np.linspace(0, len(shown) - 1, _FRAMES).round().astype(int))]
    frames: list[Image] = [paint(int(index)).image for index in chosen]
    sights = [
        _sight(number, poses.apex[index], left[index], right[index], random) for number, index in enumerate(chosen)
    ]
    names = INTRINSICS[mounted.camera.model]
    lens = Lens(mounted.camera.model, np.array([mounted.camera.intrinsics[name] for name in names]))
    stated = lens if random.uniform() < 0.8 else None
    marks = propose(frames, sights, mounted.camera.image_size, lens=stated, model=lens.model)
    errors: list[float] = []
    refused: Counter[str] = Counter()
    for answer, index in zip(marks.answers, chosen, strict=True):
        tip = answer["top"]
        if isinstance(tip, MarkProposal):
            errors.append(float(np.hypot(*(np.array(tip.pixel) - tips[index]))))
        else:
            refused[tip.reason] += 1
    drawn = ThermalCamera(seed)
    failure = marks.failure.reason if marks.failure else ""
    return ThermalOutcome(drawn.contrast_k, drawn.blur_px, len(chosen), errors, refused, failure)


def _sight(number: int, apex: Floats, left: Floats, right: Floats, random: np.random.Generator) -> Sight:
    spread = to_xyz(np.diag(_DEVIATIONS**2)[None], apex[None])[0]
    off = random.multivariate_normal(np.zeros(3), spread)
    return Sight(number, {"top": apex + off, "left": apex + left + off, "right": apex + right + off}, spread)


def main() -> None:
    """Scenes of the seeds from FIRST on, on two processors; SHORT=1: 4 of them."""
    scenes, first = 4 if os.environ.get("SHORT") else SCENES, int(os.environ.get("FIRST", "0"))
    start = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        outcomes = pool.map(run_thermal, range(first, first + scenes), chunksize=1)
    errors = [error for one in outcomes for error in one.errors_px]
    print(f"{scenes} scenes of a thermal camera, seeds {first} to {first + scenes - 1}")
    print(f"   offered {share(len(errors), sum(one.visible for one in outcomes))}, px {quantiles(errors)}")
    print(f"   within 1 px {share(sum(error <= 1.0 for error in errors), len(errors))}")
    print(f"   beyond 5 px {share(sum(error > 5.0 for error in errors), len(errors))}")
    for one in outcomes:
        marked = f"{len(one.errors_px)} of {one.visible}, px {quantiles(one.errors_px)}"
        why = one.failure or dict(one.refused)
        print(f"   {one.contrast_k:+.1f} K, blur {one.blur_px:.1f} px: {marked}; {why}")
    print(f"   painted and marked in {time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main()
