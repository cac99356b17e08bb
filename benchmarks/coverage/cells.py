"""What is asked and what is wrong in each cell of the bench."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from apexcal.documents.camera_models import DEFAULT_MODELS as MODELS
from benchmarks.coverage.calibrations import Seen
from benchmarks.coverage.marks import Errors
from workers.simulation.rig import SimulatedRig

BLUNDERS: Final = (0.0, 0.02, 0.10)
RULES: Final[dict[str, dict[str, Any]]] = {
    "default": {},
    "keep": {"loss": "mean", "outliers": "keep"},
    "saturating": {"loss": "saturating", "outliers": "keep"},
}
_PRIOR_M: Final = 0.02
_POSE_M: Final = 0.01
_POSE_DEG: Final = 1.5
_TURN_DEG: Final = 0.08
_AUTOMOTIVE: Final = 2
"""Twice the simulated camera's 960 x 600 pixels along each axis: 1920 x 1200, as usual in cars."""
SHARED: Final = ("four_a_pose", "second_half")


@dataclass(frozen=True)
class Cell:
    """A name, the camera, what is wrong, and what the request says."""

    name: str
    seen: Seen
    errors: Errors
    request: dict[str, Any]

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong but noise."""
        return self.name.startswith("clean")


def cells(rig: SimulatedRig, draw: int) -> Iterator[Cell]:
    """The cells of one recording; the special ones take the lenses in turn."""
    for share in BLUNDERS:
        for rule, request in RULES.items():
            name = f"{'clean' if share == 0.0 else f'{share:.0%}'} {rule}"
            yield from (Cell(name, Seen(lens), Errors(blunders=share), request) for lens in MODELS)
    lens = MODELS[draw % len(MODELS)]
    seen = Seen(lens)
    random = np.random.default_rng([rig.options.seed, 43])
    offset = rig.camera.T_camera_lidar.t + random.normal(0.0, _PRIOR_M, 3)
    priors = {f"t_{axis}": {"mean": float(mean), "sigma": _PRIOR_M} for axis, mean in zip("xyz", offset, strict=True)}
    yield Cell("prior_t", seen, Errors(), {"priors": priors})
    yield Cell("weights", seen, Errors(noises_px=(0.5, 2.0)), {})
    yield Cell("four_a_pose", seen, Errors(pose_m=_POSE_M), {})
    turned = Errors(second_half_deg=_TURN_DEG)
    yield Cell("second_half", Seen(lens, finer=_AUTOMOTIVE), turned, {})
    yield Cell("second_half_960", seen, turned, {})
    yield Cell("six_poses", Seen(lens, still=True), Errors(pose_m=_POSE_M, pose_deg=_POSE_DEG), {})
