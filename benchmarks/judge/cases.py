"""What each case plants: the camera, the marks, the request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from apexcal.documents.camera_models import DEFAULT_MODELS as MODELS
from apexcal.documents.camera_models import ModelName
from apexcal.documents.pairs import CLOCK_SIGMA, VELOCITY
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.poses import still
from benchmarks.coverage.walks import Paired
from benchmarks.judge.pairs import CLOCK_SIGMA_MS, draw_pairs, track_velocities
from workers.simulation.camera import FRONT

Random = np.random.Generator
Json = dict[str, Any]
NOISE_PX: Final = (0.6, 1.4)
"""Noise of a person's marks per coordinate, px."""


class Draw(NamedTuple):
    """Pairs as a correspondence set has them (`known`), what is asked, and how far the mount turned halfway."""

    paired: Paired
    known: Json
    request: Json
    turned_deg: float = 0.0


@dataclass(frozen=True)
class Case:
    """A name and how to draw it. ``is_sound``: nothing but noise and slips; ``has_trace``: residuals can show it.

    ``causes``: names of the checks that tell what was planted.
    """

    name: str
    make: Callable[[int, Random], Draw]
    is_sound: bool = False
    has_trace: bool = True
    causes: tuple[str, ...] = ()


def drawn(paired: Paired, errors: Errors, random: Random, model: str | None = None, **request: Any) -> Draw:
    noises = tuple(random.uniform(*NOISE_PX, size=2).tolist())
    known = columns(paired, replace(errors, noises_px=noises), random)
    known.pop("sigma_px", None)  # people do not state how well they mark
    if not paired.is_still:
        known[CLOCK_SIGMA] = [CLOCK_SIGMA_MS] * len(known["x"])
        known[VELOCITY] = track_velocities(paired, random).tolist()
    return Draw(paired, known, {"models": [model or paired.camera.model], **request})


def random_lens(random: Random) -> ModelName:
    return MODELS[int(random.integers(len(MODELS)))]


def _walk(errors: Errors) -> Callable[[int, Random], Draw]:
    return lambda seed, random: drawn(draw_pairs(seed, random_lens(random)), errors, random)


def _wrong_model(seed: int, random: Random) -> Draw:
    lens: ModelName = MODELS[1 + int(random.integers(len(MODELS) - 1))]
    return drawn(draw_pairs(seed, lens), Errors(), random, "pinhole")


def _decentred(seed: int, random: Random) -> Draw:
    return drawn(draw_pairs(seed, "brown_conrady", decentring=0.001), Errors(), random, "kannala_brandt")


def _wrong_prior(seed: int, random: Random) -> Draw:
    paired = draw_pairs(seed, random_lens(random))
    if random.integers(2):
        axis, sigma = int(random.integers(3)), 0.02
        true = float(paired.camera.T_camera_lidar.t[axis])
        off, name = float(random.uniform(0.06, 0.3) * random.choice([-1.0, 1.0])), f"t_{'xyz'[axis]}"
    else:
        true, name = float(paired.camera.intrinsics["f_x"]), "f_x"
        sigma = 0.01 * true
        off = float(random.uniform(0.03, 0.1) * random.choice([-1.0, 1.0])) * true
    return drawn(paired, Errors(), random, priors={name: {"mean": true + off, "sigma": sigma}})


def _six_pairs(seed: int, random: Random) -> Draw:
    paired = draw_pairs(seed, "brown_conrady")
    rows = np.sort(random.choice(len(paired.xyz), 6, replace=False))
    draw = drawn(paired, Errors(), random)
    known = {name: [values[i] for i in rows] for name, values in draw.known.items()}
    return Draw(paired, known, {"models": ["brown_conrady"], "locked": dict(paired.camera.intrinsics)})


def _two_poses(seed: int, random: Random) -> Draw:
    paired = still(draw_pairs(seed, "brown_conrady"), poses=2)
    locked = dict(paired.camera.intrinsics) if random.integers(2) else {}
    return drawn(paired, Errors(pose_m=0.005), random, locked=locked)


def _turned(seed: int, random: Random) -> Draw:
    turn = float(np.exp(random.uniform(np.log(0.15), np.log(1.5))))
    draw = drawn(draw_pairs(seed, random_lens(random)), Errors(second_half_deg=turn), random)
    return draw._replace(turned_deg=turn)


def _shutter(seed: int, random: Random) -> Draw:
    paired = draw_pairs(seed, random_lens(random))
    readout_ms = float(random.uniform(16.6, 33.3))
    return drawn(paired, Errors(line_time_us=1e3 * readout_ms / paired.camera.image_size[1]), random)


def _clock(seed: int, random: Random) -> Draw:
    late_ms = float(random.uniform(15.0, 60.0) * random.choice([-1.0, 1.0]))
    return drawn(draw_pairs(seed, random_lens(random), late_ms=late_ms), Errors(), random)


def _other_lens(seed: int, random: Random) -> Draw:
    paired = draw_pairs(seed, "brown_conrady")
    k, (width, height) = dict(paired.camera.intrinsics), paired.camera.image_size
    scale = 1.0 + float(random.uniform(0.03, 0.12) * random.choice([-1.0, 1.0]))
    centre = random.normal(0.0, 0.01 * width, 2)
    K = [k["f_x"] * scale, 0.0, k["c_x"] + centre[0], 0.0, k["f_y"] * scale, k["c_y"] + centre[1], 0.0, 0.0, 1.0]
    D = [k["k1"] * random.uniform(0.6, 1.4), k["k2"] * random.uniform(0.6, 1.4), k["k3"], k["k4"], k["k5"]]
    stated = {"width": width, "height": height, "distortion_model": "plumb_bob", "K": K, "D": D}
    way = ("prior", "locked")[int(random.integers(2))]
    return drawn(paired, Errors(), random, intrinsics={FRONT: stated}, intrinsics_as=way)


def _worn_tip(seed: int, random: Random) -> Draw:
    """The marks show the worn tip; the vertex is where the edges would meet, above it."""
    draw = drawn(draw_pairs(seed, random_lens(random)), Errors(), random)
    draw.known["z"] = [z + float(random.uniform(0.005, 0.008)) for z in draw.known["z"]]
    return draw


def _lasting(seed: int, random: Random) -> Draw:
    return drawn(draw_pairs(seed, random_lens(random)), Errors(elevation_deg=float(random.normal(0.0, 0.04))), random)


CASES: Final = (
    Case("people, none wrong", _walk(Errors()), is_sound=True),
    Case("people, 2 % wrong", _walk(Errors(blunders=0.02)), is_sound=True),
    Case("5 % on the hand", _walk(Errors(on_hand=0.05))),
    Case("15 % on the hand", _walk(Errors(on_hand=0.15))),
    Case("wrong model", _wrong_model),
    Case("decentring, kannala_brandt", _decentred),
    Case("wrong prior", _wrong_prior),
    Case("six pairs", _six_pairs),
    Case("two poses", _two_poses),
    Case("turned halfway", _turned),
    Case("rolling shutter", _shutter),
    Case("clocks apart", _clock),
    Case("lens of another camera", _other_lens),
    Case("worn tip", _worn_tip, has_trace=False),
    Case("elevation that lasts", _lasting, has_trace=False),
)
KEPT: Final = Case(
    "15 % on the hand, kept",
    lambda seed, random: drawn(
        draw_pairs(seed, random_lens(random)), Errors(on_hand=0.15), random, outliers="keep", loss="mean"
    ),
)
"""Of remedies alone: a request that leaves out no pairs, and counts all of them whole."""
