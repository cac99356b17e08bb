"""One calibration by the product's own path: planned by the service, fitted by a worker, concluded by the service.

Some work is saved. A model's search runs once on a walk's clean marks, and every fit of that model starts from its
end: searches end in the same optimum wherever they start (`make bench-accuracy`), so the bests of its slots need no
further look.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.camera_models import ModelName
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import CameraSummary
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.poses import still
from benchmarks.coverage.walks import Paired, Walked, pair
from service.calibrations.plan import CalibrationPlan, plan_request
from service.calibrations.resolve import CameraPairs
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, CorrespondenceSet
from service.platform.db.fleets import RigCamera
from workers.models.summary import CameraFit, camera_summary
from workers.simulation.camera import FRONT
from workers.solver.problem import FitProblem
from workers.solver.schedule import State, run_schedule
from workers.tasks.solving import read_run, solved

Floats = NDArray[np.float64]
Request = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Calibration:
    """The camera's summary, and each model's problem and result of a fit to all pairs (``known``, columns)."""

    paired: Paired
    errors: Errors
    summary: CameraSummary
    results: dict[str, FitResult]
    known: Json
    problems: dict[str, FitProblem]


@dataclass(frozen=True)
class Seen:
    """A camera and what it sees: the true lens, how much finer its pixels are, and a walk or poses."""

    lens: ModelName
    finer: int = 1
    still: bool = False


class Bench:
    """A walk seen through each lens, and the ends of the searches on it."""

    def __init__(self, walked: Walked) -> None:
        self._walked = walked
        self._paired: dict[Seen, Paired] = {}
        self._searched: dict[tuple[ModelName, bool, tuple[int, int], str], State] = {}

    def calibrate(self, seen: Seen, errors: Errors, request: Request, draw: int) -> Calibration:
        """Marks of this draw, calibrated by all models as the request asks."""
        paired = self.pairs(seen)
        random = np.random.default_rng([self._walked.rig.options.seed, 41, draw])
        return self.fit(paired, errors, columns(paired, errors, random), request)

    def fit(self, paired: Paired, errors: Errors, known: Json, request: Request) -> Calibration:
        """These pairs, calibrated as the request asks."""
        plan = planned(paired, known, request)
        states = self._states(paired, {fit.request.model for fit in plan.fits})
        fits: list[CameraFit] = []
        problems: dict[str, FitProblem] = {}
        for fit in plan.fits:
            model = fit.request.model
            for fold in range(FULL, fit.request.folds):
                given = read_run(fit.of_fold(fold), fold, known)
                if fold == FULL:
                    problems[model] = given.problem
                fits.append(CameraFit(uuid4(), None if fold == FULL else fold, solved(given, states[model])))
        summary = camera_summary(fits)
        full = {fit.result.model: fit.result for fit in fits if fit.heldout_fold is None}
        return Calibration(paired, errors, summary, full, known, problems)

    def pairs(self, seen: Seen) -> Paired:
        """The walk's pairs of that camera."""
        if seen not in self._paired:
            paired = pair(self._walked, seen.lens, finer=seen.finer)
            self._paired[seen] = still(paired) if seen.still else paired
        return self._paired[seen]

    def _states(self, paired: Paired, models: Collection[str]) -> dict[str, State]:
        of = (paired.camera.model, paired.is_still, paired.camera.image_size)
        clean = columns(paired, Errors(), np.random.default_rng(self._walked.rig.options.seed))
        for fit in planned(paired, clean, {}).fits:
            model = fit.request.model
            if model in models and (*of, model) not in self._searched:
                problem = read_run(fit.of_fold(FULL), FULL, clean).problem
                self._searched[*of, model] = replace(run_schedule(problem)[0], first_slot_parameters=())
        return {model: self._searched[*of, model] for model in models}


def planned(paired: Paired, known: Json, request: Request) -> CalibrationPlan:
    width, height = paired.camera.image_size
    camera = RigCamera(name=FRONT, image_width=width, image_height=height, nominal=paired.nominal, bounds={})
    pairs = CorrespondenceSet(
        pairs=known, count=len(known["x"]), notes=[], source="import" if paired.is_still else "annotations"
    )
    return plan_request(CalibrationTemplate.model_validate(request), [CameraPairs(camera, pairs)])
