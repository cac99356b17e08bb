"""Grey levels and outlines of what stands in a scene's frames: background, board, hands, people; and the smear."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.marks.draws import Draw

Floats = NDArray[np.float64]
_EDGE_SIGMA_M: Final = 0.0008  # the tolerance of ISO 2768-1 m for lengths of 0.4 to 1 m, as a standard deviation
_EDGE_STEPS: Final = 8
_UP: Final = np.array([0.0, 0.0, 1.0])


def background(drawn: Draw, random: np.random.Generator) -> NDArray[np.uint8]:
    """Soft texture of several scales, slanted boxes and poles."""
    width, height = drawn.size
    image = np.full((height, width), random.uniform(70.0, 170.0), np.float32)
    for cell in (160, 40, 10, 3):
        grain = random.normal(0.0, drawn.texture / 2.0, (height // cell + 2, width // cell + 2)).astype(np.float32)
        image += np.asarray(cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
    for _ in range(int(random.uniform(3, 25))):
        middle, half = random.uniform((0, 0), (width, height)), random.uniform(10.0, 0.2 * width, 2)
        box = cv2.boxPoints(
            (middle.tolist(), half.tolist(), float(random.choice([0.0, 90.0, random.uniform(0, 90)])))
        )
        cv2.fillPoly(
            image, [np.rint(box).astype(np.int32)], float(image.mean() + random.normal(0.0, 2.0 * drawn.texture))
        )
    return np.clip(np.rint(image), 1, 254).astype(np.uint8)


def board_levels(
    drawn: Draw, random: np.random.Generator, background: NDArray[np.uint8]
) -> list[tuple[tuple[float, float, float, float], int]]:
    """Cells of the board (from, to along the left edge, from, to along the right one, as shares) and grey levels."""
    behind = float(np.median(background))
    sign = (
        -1.0
        if behind + drawn.contrast > 235.0 or (random.uniform() < 0.5 and behind > drawn.contrast + 20.0)
        else 1.0
    )
    base = int(np.clip(behind + sign * drawn.contrast, 3, 252))
    inner = int(np.clip(base + random.choice([-1, 1]) * random.uniform(25.0, 90.0), 3, 252))
    cells = [((0.0, 1.0, 0.0, 1.0), base)]
    if drawn.pattern == "border":
        rim = random.uniform(0.05, 0.15)
        cells.append(((rim, 1.0 - rim, rim, 1.0 - rim), inner))
    if drawn.pattern == "chess":
        m, n = int(random.uniform(4, 9)), int(random.uniform(4, 9))
        cells += [
            ((i / m, (i + 1) / m, j / n, (j + 1) / n), inner) for i in range(m) for j in range(n) if (i + j) % 2 == 0
        ]
    if drawn.pattern == "tag":
        grid = np.linspace(0.15, 0.85, 8)
        bits = random.uniform(size=(7, 7)) < 0.5
        cells += [
            ((grid[i], grid[i + 1], grid[j], grid[j + 1]), inner) for i in range(7) for j in range(7) if bits[i, j]
        ]
    return cells


def cut_cells(
    drawn: Draw, random: np.random.Generator, levels: list[tuple[tuple[float, float, float, float], int]]
) -> list[tuple[tuple[float, float, float, float], int]]:
    """The cells of a board whose four edges were cut a little off."""
    long = (drawn.board_m[0], drawn.board_m[0], drawn.board_m[1], drawn.board_m[1])
    off = random.normal(0.0, _EDGE_SIGMA_M, 4) / long

    def moved(cell: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        a, b, c, d = (
            value + shift if value in (0.0, 1.0) else value for value, shift in zip(cell, off.tolist(), strict=True)
        )
        return a, b, c, d

    return [(moved(cell), level) for cell, level in levels]


def rectangle(
    apex: Floats, ways: tuple[Floats, Floats], board_m: tuple[float, float], cell: tuple[float, float, float, float]
) -> Floats:
    a, b, c, d = cell
    corners = np.array([(a, c), (b, c), (b, d), (a, d)]) * board_m
    part = np.arange(_EDGE_STEPS)[:, None] / _EDGE_STEPS
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    outline = np.concatenate([start + part * (end - start) for start, end in sides])
    return apex + outline[:, :1] * ways[0] + outline[:, 1:] * ways[1]


def hands(apex: Floats, ways: tuple[Floats, Floats], board_m: tuple[float, float]) -> list[Floats]:
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None]
    disc = 0.045 * (np.cos(turn) * ways[0] + np.sin(turn) * ways[1])
    return [apex + 0.6 * board_m[k] * ways[k] + disc for k in range(2)]


def person(body: Floats, left: Floats, height: float, ground_z: float) -> list[Floats]:
    """Outlines of both legs, the torso and the head."""
    base, side = np.array([body[0], body[1], ground_z]), np.array([left[0], left[1], 0.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)[:, None]

    def box(middle: float, half: float, low: float, high: float) -> Floats:
        places = ((middle - half, low), (middle + half, low), (middle + half, high), (middle - half, high))
        return np.array([base + across * side + up * _UP for across, up in places])

    head = base + (height - 0.105) * _UP + 0.105 * (np.cos(turn) * side + np.sin(turn) * _UP)
    return [
        box(-0.1, 0.08, 0.0, 0.5 * height),
        box(0.1, 0.08, 0.0, 0.5 * height),
        box(0.0, 0.2, 0.48 * height, height - 0.22),
        head,
    ]


def smeared(image: NDArray[np.float32], moved: Floats) -> NDArray[np.float32]:
    """The image smeared along a way of so many pixels, as a moving board is; the truth is its middle."""
    length = float(np.hypot(*moved))
    if not np.isfinite(length) or length < 0.3:
        return image
    count = int(np.ceil(length * 2.0)) + 1
    shifts = np.linspace(-0.5, 0.5, count)[:, None] * moved
    total = np.zeros_like(image)
    for du, dv in shifts:
        total += cv2.warpAffine(
            image, np.array([[1.0, 0.0, du], [0.0, 1.0, dv]]), image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE
        )
    return total / np.float32(count)
