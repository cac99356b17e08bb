"""What a seed draws of a scene, and the cells that were drawn from what real crops show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from workers.geometry.models import ModelName

Pattern = Literal["plain", "border", "chess", "tag"]


@dataclass(frozen=True, slots=True)
class Draw:
    """What a seed draws.

    Attributes:
        contrast: grey levels between the board and what is behind it on average; its sign is drawn too.
        blur_px: standard deviation. motion_ms: exposure.
        gain_step: factor by which the exposure changes for some of the frames.
        sharpening: amount of an unsharp mask. rim_m: a lit or dark rim outside of one upper edge, in half of the
            frames. blunt_m: what is cut off the tip along both edges. `draw` leaves these three at 0 (see `CELLS`).
        clock_ms: how far the camera's clock is ahead of the one by which frames were paired.
        upper_corner: which corner ``top`` is where the board's edges are level but for the roll; 0: a corner is up.
    """

    seed: int
    size: tuple[int, int]
    model: ModelName
    lens_stated: bool
    still: bool
    count: int
    board_m: tuple[float, float]
    size_stated: bool
    pattern: Pattern
    contrast: float
    texture: float
    blur_px: float
    noise: float
    motion_ms: float
    head_above_m: float
    second: Literal["none", "beside", "behind"]
    gain_step: float
    tip_outside: bool
    thermal: bool
    sharpening: float = 0.0
    rim_m: float = 0.0
    blunt_m: float = 0.0
    clock_ms: float = 0.0
    upper_corner: int = 0


CELLS: Final[dict[str, dict[str, float]]] = {
    "neither": {},
    "sharpened": {"sharpening": 1.0},
    "rims": {"rim_m": 0.01},
    "blunt": {"blunt_m": 0.01},
    "all three": {"sharpening": 1.0, "rim_m": 0.01, "blunt_m": 0.01},
    "upper left": {"upper_corner": 1},
    "upper right": {"upper_corner": -1},
}
"""As crops of `vlp16-diamond-board` show them, poses from 0. Sharpening: undershoots of 15 to 25 % on both sides of
edges in poses 2, 3, 11, 14. Rims: a strip of 3 to 6 px, a centimetre, along the upper left edge in poses 4, 5, 10,
12, 16, 18, the published corner at its inner side. Blunt: the tips of poses 10 and 16 end some pixels early."""


def cell_draw(seed: int, cell: str) -> Draw:
    """Still poses of a plain board in visible light, with lens and size stated, of this cell."""
    return replace(
        draw(seed), still=True, count=14, pattern="plain", head_above_m=0.0, second="none", thermal=False,
        size=(1920, 1200), lens_stated=True, size_stated=True, tip_outside=False, motion_ms=0.0, gain_step=1.0,
        **CELLS[cell],  # pyright: ignore[reportArgumentType]
    )  # fmt: skip


def draw(seed: int) -> Draw:
    """The scene of a seed."""
    random = np.random.default_rng([seed, 37])
    uniform = random.uniform
    thermal = bool(uniform() < 0.12)
    fisheye = bool(uniform() < 0.2)
    still = bool(uniform() < 0.4)
    short = uniform(0.45, 0.9)
    board = (short, min(short * (1.0 if uniform() < 0.3 else uniform(1.1, 1.6)), 1.3))
    outside = bool(uniform() < 0.12)
    sizes = ((1920, 1080), (1920, 1200), (1280, 720), (960, 600))
    return Draw(
        seed=seed,
        size=(640, 512) if thermal else sizes[int(random.choice(4, p=[0.4, 0.2, 0.2, 0.2]))],
        model="kannala_brandt" if fisheye else ("brown_conrady" if uniform() < 0.7 else "pinhole"),
        lens_stated=bool(uniform() < 0.8) or fisheye,
        still=still,
        count=int(uniform(10, 26)) if still else int(uniform(30, 61)),
        board_m=board if uniform() < 0.5 else board[::-1],
        size_stated=bool(uniform() < 0.65) or outside,
        pattern=str(random.choice(["plain", "border", "chess", "tag"], p=[0.5, 0.2, 0.2, 0.1])),  # type: ignore[arg-type]
        contrast=float(uniform(15.0, 120.0)),
        texture=float(uniform(2.0, 20.0)),
        blur_px=float(uniform(0.0, 2.5)),
        noise=float(uniform(0.7, 3.5)),
        motion_ms=0.0 if still else float(uniform(0.0, 12.0)),
        head_above_m=float(uniform(0.03, 0.2)) if uniform() < 0.25 else 0.0,
        second=str(random.choice(["none", "beside", "behind"], p=[0.75, 0.15, 0.1])),  # type: ignore[arg-type]
        gain_step=float(uniform(1.1, 1.6)) if uniform() < 0.25 else 1.0,
        tip_outside=outside,
        thermal=thermal,
    )
