"""Whole walks: a board overhead, marks of people and of the machine, clocks and lenses nearly right, habits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from apexcal.documents.pairs import CONFIRMED, MACHINE, MACHINE_OFF, MARK_SIGMA, MARKED_BY
from benchmarks.coverage.marks import Errors
from benchmarks.coverage.walks import Paired
from benchmarks.judge.cases import Case, Draw, Random, drawn
from benchmarks.judge.pairs import draw_pairs
from workers.simulation.camera import FRONT

FEW: Final = (40, 60)
"""Marks of a walk that a person makes in some minutes."""
OVERHEAD_M: Final = (0.15, 0.6)
"""Heights of the tip within a walk: marks then span 9 to 26 % of the image's height."""
MACHINE_PX: Final = 0.2
HABIT_PX: Final = 1.5
_PEOPLE: Final = ("people",)
CLOCKS_MS: Final = (0.0, 2.0, 4.0)


def _overhead(seed: int, random: Random, late_ms: float = 0.0, pairs: tuple[int, int] = (200, 260)) -> Paired:
    heights_m = float(random.uniform(*OVERHEAD_M))
    return draw_pairs(seed, "brown_conrady", late_ms=late_ms, pairs=pairs, heights_m=heights_m)


def _lens(paired: Paired, scale: float = 1.0) -> dict[str, Any]:
    """What a CameraInfo with the true lens says, or with its focal lengths scaled."""
    k, (width, height) = dict(paired.camera.intrinsics), paired.camera.image_size
    K = [k["f_x"] * scale, 0.0, k["c_x"], 0.0, k["f_y"] * scale, k["c_y"], 0.0, 0.0, 1.0]
    D = [k[name] for name in ("k1", "k2", "k3", "k4", "k5")]
    lens = {"width": width, "height": height, "distortion_model": "plumb_bob", "K": K, "D": D}
    return {"intrinsics": {FRONT: lens}, "intrinsics_as": "locked"}


def _by_machine(draw: Draw, random: Random) -> Draw:
    """The same pairs with the machine's marks, which a person confirmed."""
    pixels = draw.paired.camera.project(draw.paired.places(draw.paired.taken_ns))
    pixels = pixels + random.normal(0.0, MACHINE_PX, pixels.shape)
    count = len(pixels)
    columns = dict(zip(("u", "v"), pixels.T.tolist(), strict=True)) | {MACHINE: [True] * count}
    columns |= {CONFIRMED: [1] * count, MARK_SIGMA: [MACHINE_PX] * count, MARKED_BY: [[]] * count}
    return draw._replace(known=draw.known | columns)


def _true_lens(seed: int, random: Random) -> Draw:
    """A true lens, and vertices of which most of the error lasts."""
    paired = draw_pairs(seed, "brown_conrady", lasting=0.9, heights_m=float(random.uniform(*OVERHEAD_M)))
    return drawn(paired, Errors(), random, **_lens(paired))


def _late(late_ms: float) -> Callable[[int, Random], Draw]:
    def make(seed: int, random: Random) -> Draw:
        paired = _overhead(seed, random, late_ms * float(random.choice([-1.0, 1.0])), FEW)
        return drawn(paired, Errors(), random, **_lens(paired))

    return make


def _whole(by_machine: bool, late_ms: float, scale: float) -> Callable[[int, Random], Draw]:
    def make(seed: int, random: Random) -> Draw:
        paired = _overhead(seed, random, late_ms)
        draw = drawn(paired, Errors(), random, **_lens(paired, scale))
        return _by_machine(draw, random) if by_machine else draw

    return make


def _free_lens(seed: int, random: Random) -> Draw:
    """The true lens is stated, and the request leaves it to marks over a low part of the image."""
    paired = _overhead(seed, random)
    return drawn(paired, Errors(), random, **_lens(paired) | {"intrinsics_as": "free"})


def _habit(people: int, *, is_compared: bool) -> Callable[[int, Random], Draw]:
    """One of the people marks 1.5 px beside the corner; the machine's marks are compared, or there are none."""

    def make(seed: int, random: Random) -> Draw:
        draw = drawn(draw_pairs(seed, "brown_conrady"), Errors(), random)
        known, count = draw.known, len(draw.known["u"])
        person = np.arange(count) % people
        turn = float(random.uniform(0.0, 2.0 * np.pi))
        shift = np.where(person[:, None] == 0, HABIT_PX * np.array([np.cos(turn), np.sin(turn)]), 0.0)
        truth = draw.paired.camera.project(draw.paired.places(draw.paired.taken_ns))
        marks = truth + shift + random.normal(0.0, 1.0, truth.shape)
        known |= dict(zip(("u", "v"), marks.T.tolist(), strict=True)) | {
            MARKED_BY: [[one] for one in person.tolist()]
        }
        known.pop(MARK_SIGMA, None)
        if is_compared:
            machine = truth + random.normal(0.0, MACHINE_PX, truth.shape)
            known[MACHINE_OFF] = (machine - marks).tolist()
        return draw

    return make


WHOLE_WALK: Final = ("walk, people's marks", "walk, machine's marks")
"""How names of whole walks begin."""


def _name(by_machine: bool, late_ms: float, scale: float) -> str:
    who, lens = "machine's" if by_machine else "people's", "right" if scale == 1.0 else "0.2 % off"
    return f"walk, {who} marks, clock {late_ms:g} ms, lens {lens}"


WALKS: Final = (
    Case("walk, true lens, lasting errors", _true_lens, is_sound=True),
    *(
        Case(f"walk, few marks, clock {late_ms:g} ms", _late(late_ms), causes=("clock",))
        for late_ms in (5.0, 20.0, 50.0)
    ),
    *(
        Case(
            *(_name(by_machine, late_ms, scale), _whole(by_machine, late_ms, scale)),
            is_sound=True,
            causes=("clock",) * (late_ms > 0.0) + ("stated_lens", "lens_model") * (scale != 1.0),
        )
        for by_machine in (False, True)
        for late_ms in CLOCKS_MS
        for scale in (1.0, 1.002)
    ),
    Case("walk, one of three aims 1.5 px beside", _habit(3, is_compared=True), causes=_PEOPLE),
    Case("walk, one alone aims 1.5 px beside, seen", _habit(1, is_compared=True), causes=_PEOPLE),
    Case("walk, one alone aims 1.5 px beside, unseen", _habit(1, is_compared=False), has_trace=False, causes=_PEOPLE),
)
FREE_LENS: Final = Case("walk, the stated lens left free", _free_lens)
