"""One rendered scene through the machine: what it offered, how far off, and at what cost."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from apexcal.documents.corners import CORNERS, CornerName
from benchmarks.marks.draws import Draw, cell_draw, draw
from benchmarks.marks.scenes import Scene
from workers.marks.propose import propose
from workers.marks.sights import Image, MarkProposal


@dataclass(slots=True)
class CornerCounts:
    """Of the visible corners of one name.

    Attributes:
        errors_px: of the proposals.
        scores: of their coordinates, in stated deviations.
        refused: reasons of the others.
    """

    visible: int = 0
    errors_px: list[float] = field(default_factory=list[float])
    scores: list[float] = field(default_factory=list[float])
    refused: Counter[str] = field(default_factory=Counter[str])

    def add(self, other: CornerCounts) -> None:
        self.visible += other.visible
        self.errors_px += other.errors_px
        self.scores += other.scores
        self.refused += other.refused


@dataclass(slots=True)
class SceneOutcome:
    """What became of a scene; `failure` names why it has no mount, `seconds` is processor time for each frame."""

    drawn: Draw
    frames: int
    failure: str | None
    seconds: float
    corners: dict[CornerName, CornerCounts]


def run_scene(seed: int) -> SceneOutcome | None:
    """None where the drawn camera sees too little of the drawn walk."""
    return run_drawn(draw(seed))


def run_cell(seed_and_cell: tuple[int, str]) -> tuple[str, SceneOutcome | None]:
    """The cell, and what became of its scene."""
    return seed_and_cell[1], run_drawn(cell_draw(*seed_and_cell))


def run_drawn(drawn: Draw) -> SceneOutcome | None:
    """None where the drawn camera sees too little of the drawn walk."""
    scene = Scene(drawn)
    if len(scene) < 8:
        return None
    frames: list[Image] = [scene[index] for index in range(len(scene))]
    asked: tuple[CornerName, ...] = CORNERS if drawn.size_stated else ("top",)
    start = time.process_time()
    found = propose(
        frames,
        scene.sights,
        drawn.size,
        lens=scene.lens,
        model=drawn.model,
        corners=asked,
        upper_corner=drawn.upper_corner,
    )
    seconds = (time.process_time() - start) / len(frames)
    counts: dict[CornerName, CornerCounts] = {name: CornerCounts() for name in asked}
    for index, answers in enumerate(found.answers):
        for name in asked:
            if not scene.visible(index, name):
                continue
            count, answer = counts[name], answers.get(name)
            count.visible += 1
            if not isinstance(answer, MarkProposal):
                count.refused[answer.reason if answer else "none"] += 1
                continue
            off = np.array(answer.pixel) - scene.truth[name][index]
            count.errors_px.append(float(np.hypot(*off)))
            count.scores += (np.abs(off) / np.sqrt(np.diag(answer.covariance))).tolist()
    return SceneOutcome(drawn, len(frames), found.failure.reason if found.failure else None, seconds, counts)


def quantiles(values: list[float]) -> str:
    """Median and ninth decile."""
    return "median {:.2f}, 90 % {:.2f}".format(*np.quantile(values, [0.5, 0.9])) if values else "none"
