"""A calibration request planned: its cameras, their fits, the seed, the folds, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.camera_models import ModelName, parameter_names
from apexcal.documents.fit_requests import FitRequest
from apexcal.documents.schedules import PRESETS, Schedule
from service.calibrations.fold_rules import fold_count
from service.calibrations.pair_rules import weighing_note
from service.calibrations.resolve import (
    CameraPairs,
    ResolvedCamera,
    ResolvedTemplate,
    resolve_cameras,
    resolve_fits,
    resolve_template,
)
from service.calibrations.work_rules import Wanted, check_work, cost_of, predicted_s
from service.db.base import Json
from service.db.digests import content_hash
from service.http.problems import Problem
from service.jobs.costs import RunCost


@dataclass(frozen=True)
class FitPlan:
    """One model on one camera's pairs; each of the request's folds is held out in turn, besides the fit to all pairs.

    ``cost`` is that of one run.
    """

    camera: ResolvedCamera
    request: FitRequest
    cost: RunCost

    @property
    def model(self) -> ModelName:
        """The camera model that is fitted."""
        return self.request.model

    @property
    def folds(self) -> int:
        """How many parts of the pairs are held out."""
        return self.request.folds

    def of_fold(self, fold: int) -> Json:
        """The request of one run as it is stored: without one part of the pairs, or -1, of all."""
        return self.request.model_copy(update={"fold": fold}).model_dump(mode="json")


@dataclass(frozen=True)
class CalibrationPlan:
    """Everything that a request comes to."""

    fits: list[FitPlan]
    schedule: Schedule
    content_hash: str
    request: Json
    notes: list[str]

    @property
    def predicted_s(self) -> float:
        """Processor seconds of all its work, at most."""
        return predicted_s(
            Wanted(fit.camera.name, fit.model, fit.camera.pairs.count, 1 + fit.folds, fit.cost) for fit in self.fits
        )


def plan_request(wanted: CalibrationTemplate, sources: Sequence[CameraPairs]) -> CalibrationPlan:
    """Check a request against its rig and pairs, and resolve what each fit is to do.

    Raises:
        DocumentError, Problem: 422 of the functions of :mod:`service.calibrations.resolve`, of
            :func:`~service.calibrations.work_rules.check_work`, and ``too_few_pairs``.
    """
    template = resolve_template(wanted)
    cameras = resolve_cameras(template, sources)
    work = _work(template, cameras)
    check_work(work, template.schedule)
    resolved = [(camera, fit) for camera in cameras for fit in resolve_fits(template, camera)]
    digest = _digest(template, cameras, [fit for _, fit in resolved])
    seed = wanted.seed if wanted.seed is not None else int(digest[:13], 16)  # 52 bits
    notes = [note for camera in cameras for note in camera.notes(template)]
    folds: dict[str, dict[str, int]] = {}
    for camera in cameras:
        free = {fit.model: _free(camera, fit) for one, fit in resolved if one is camera}
        folds[camera.name], sentences = fold_count(camera.pairs.columns, wanted.folds, free, camera.name)
        notes += sentences
    fits: list[FitPlan] = []
    for (camera, fit), one in zip(resolved, work, strict=False):
        notes += weighing_note(camera.name, fit.weights)
        update = {"seed": seed, "folds": folds[camera.name][fit.model]}
        fits.append(FitPlan(camera, fit.model_copy(update=update), one.cost))
    preset = PRESETS[wanted.preset]
    request = wanted.model_dump(mode="json") | {
        "models": template.models,
        "seed": seed,
        "search": template.search,
        "bounds_preset": wanted.bounds_preset or preset.bounds,
        "loss": wanted.loss or preset.loss,
        "outliers": wanted.outliers or preset.outliers,
    }
    return CalibrationPlan(fits, template.schedule, digest, request, list(dict.fromkeys(notes)))


def _work(template: ResolvedTemplate, cameras: Sequence[ResolvedCamera]) -> list[Wanted]:
    """What each fit costs. A template without cameras is looked at as for a camera without pairs."""
    fits: list[tuple[str, ModelName, int]] = [
        (camera.name, model, camera.pairs.count) for camera in cameras for model in camera.models
    ]
    return [
        Wanted(camera, model, pairs, 1 + template.asked.folds, cost_of(model, pairs, template.schedule))
        for camera, model, pairs in fits or [("", model, 0) for model in template.models]
    ]


def _digest(template: ResolvedTemplate, cameras: Sequence[ResolvedCamera], fits: Sequence[FitRequest]) -> str:
    return content_hash(
        {
            "folds": template.asked.folds,
            "fits": [fit.model_dump(mode="json") for fit in fits],
            # Not the sets' own hashes, which say where the pairs came from too: the same pairs give the same bits.
            "pairs": {camera.name: content_hash(camera.pairs.columns) for camera in cameras},
        }
    )


def _free(camera: ResolvedCamera, fit: FitRequest) -> int:
    """The number of free parameters. Raises Problem 422 ``too_few_pairs``, there are fewer pairs."""
    free = len(parameter_names(fit.model, fit.search)) - len(fit.locked)
    pairs = camera.pairs.count
    if pairs < max(free, 1):
        noun = "pair" if pairs == 1 else "pairs"
        raise Problem(
            422,
            "too_few_pairs",
            f"{camera.name} has {pairs} {noun}, and {fit.model} has {free} free parameters.",
            "Mark more vertices, or lock what is known (intrinsics, lever arm), or ask for a smaller model.",
            pairs=pairs,
            free_parameters=free,
        )
    return free
