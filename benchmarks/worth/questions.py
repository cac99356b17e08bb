"""What is varied, and over which values: each question is one curve of every method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.bounds import DEFAULT_ROTATION_RANGE_DEG
from benchmarks.accuracy.rigs import PAIRS, Rig, draw_rig, with_outliers
from benchmarks.worth.methods import Case, compare
from benchmarks.worth.mistakes import other_corner, slipped_run, swapped_neighbours
from benchmarks.worth.walks import (
    field,
    flat_field,
    one_line,
    random_turn,
    remounted,
    walked,
)
from workers.geometry.models import DEFAULT_MODELS as MODELS
from workers.geometry.models import ModelName, parameter_names

Floats = NDArray[np.float64]
Marking = Callable[[Rig, float, np.random.Generator], Floats]
CHECKS = 300
"""Noiseless vertices over the field on which a calibration is checked."""


@dataclass(frozen=True)
class Question:
    """One quantity that is varied.

    values: where rigs are drawn, in the unit of `label`; make(model, value, rng) draws one, models are those it is
    drawn for, in turn. counts_pairs: the value is the number of pairs, of which a model needs one for each free
    parameter.
    """

    label: str
    values: tuple[float, ...]
    make: Callable[[ModelName, float, np.random.Generator], Case]
    models: tuple[ModelName, ...] = MODELS
    counts_pairs: bool = False

    def models_at(self, value: float) -> tuple[ModelName, ...]:
        """The models that can be asked for at this value."""
        if self.counts_pairs:
            return tuple(model for model in self.models if value >= len(parameter_names(model, "rotation_vector")))
        return self.models


def case_of(question: Question, model: ModelName, value: float, rng: np.random.Generator) -> Case:
    """A fresh case; rigs whose walk the image does not hold are drawn again."""
    for _ in range(200):
        try:
            return question.make(model, value, rng)
        except _NotSeenError:
            continue
    raise ValueError(f"No rig can be drawn for {question.label} at {value}.")


class _NotSeenError(Exception):
    """The camera sees too little of the walk."""


def _must(rig: Rig | None) -> Rig:
    if rig is None:
        raise _NotSeenError
    return rig


def _checked(rig: Rig, rng: np.random.Generator, **request: Any) -> Case:
    return Case(rig, _must(walked(rig, field(rng), CHECKS, rng, noise_px=0.0)), request)


def _mount(model: ModelName, value: float, rng: np.random.Generator) -> Case:
    rig = remounted(draw_rig(model, rng), random_turn(value, rng))
    return _checked(rig, rng, rotation_range_deg=value)


def _pairs(model: ModelName, value: float, rng: np.random.Generator) -> Case:
    rig = draw_rig(model, rng)
    return _checked(_must(walked(rig, field(rng), round(value), rng)), rng)


def _on_plane(model: ModelName, value: float, rng: np.random.Generator) -> Case:
    rig = draw_rig(model, rng)
    return _checked(_must(walked(rig, flat_field(value, rng), PAIRS, rng)), rng)


def _on_line(model: ModelName, value: float, rng: np.random.Generator) -> Case:
    rig = draw_rig(model, rng)
    return _checked(_must(walked(rig, one_line(value, rng), PAIRS, rng)), rng)


def _marked(
    marking: Marking, reach_deg: float = DEFAULT_ROTATION_RANGE_DEG
) -> Callable[[ModelName, float, np.random.Generator], Case]:
    def make(model: ModelName, value: float, rng: np.random.Generator) -> Case:
        rig = draw_rig(model, rng, any_mount=reach_deg == 180.0)
        try:
            marks = marking(rig, 0.01 * value, rng)
        except ValueError as error:
            raise _NotSeenError from error
        checked = _checked(rig, rng, loss="saturating", rotation_range_deg=reach_deg)
        return Case(Rig(model, rig.image_size, rig.points, marks, rig.truth), checked.check, checked.request)

    return make


def _anywhere(rig: Rig, share: float, rng: np.random.Generator) -> Floats:
    return with_outliers(rig, share, rng)[0]


_THICKNESS_M = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
_SHARES = (10.0, 20.0, 30.0, 40.0, 50.0)
QUESTIONS: Mapping[str, Question] = {
    "mount": Question("mount known to ± (degrees)", (5.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0, 180.0), _mount),
    "pairs": Question("pairs", (12.0, 16.0, 24.0, 40.0, 80.0, 222.0), _pairs, counts_pairs=True),
    "outliers_random": Question("wrong marks anywhere (% of 222)", (0.0, *_SHARES, 60.0), _marked(_anywhere)),
    "outliers_any_mount": Question("the same, mount unknown", (0.0, *_SHARES, 60.0), _marked(_anywhere, 180.0)),
    "outliers_corner": Question("another corner of the board (%)", _SHARES, _marked(other_corner)),
    "outliers_swapped": Question("next frames swapped (%)", _SHARES, _marked(swapped_neighbours)),
    "outliers_run": Question("one run slipped by a frame (%)", _SHARES, _marked(slipped_run)),
    "plane": Question("spread of the heights (m)", _THICKNESS_M, _on_plane),
    "line": Question("thickness of a line (m)", _THICKNESS_M, _on_line),
}

Place = tuple[str, int, int]
"""A question, the index of its value, and the number of the rig there."""


def answer(place: Place, seed: int) -> dict[str, Any]:
    """What one fresh rig tells, reproducible from the seed and its place; the models take turns."""
    name, at, number = place
    question = QUESTIONS[name]
    rng = np.random.default_rng((seed, list(QUESTIONS).index(name), at, number))
    models = question.models_at(question.values[at])
    case = case_of(question, models[number % len(models)], question.values[at], rng)
    return compare(case, int(rng.integers(2**31)))
