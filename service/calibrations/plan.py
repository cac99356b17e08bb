"""A calibration request planned: its cameras, their fits, the seed, the folds, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.camera_models import ModelName, parameter_names
from apexcal.documents.fit_requests import FitRequest
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
from service.calibrations.work_rules import FitWork, check_work, predicted_s
from service.platform.db.base import Json, content_hash
from service.platform.http.problems import unprocessable
from service.platform.jobs.bundles import run_cost

# Members of a request that default to what its preset means.
_OF_PRESET: Final = ("search", "bounds_preset", "loss", "outliers")


@dataclass(frozen=True)
class FitPlan:
    """One model on one camera's pairs: a fit to all, and one without each of the request's folds."""

    camera: ResolvedCamera
    request: FitRequest
    work: FitWork

    def of_fold(self, fold: int) -> Json:
        """The request of one run as it is stored: without one part of the pairs, or -1, of all."""
        return self.request.model_copy(update={"fold": fold}).model_dump(mode="json")


@dataclass(frozen=True)
class CalibrationPlan:
    """Everything that a request comes to."""

    fits: list[FitPlan]
    content_hash: str
    request: Json
    notes: list[str]

    @property
    def runs(self) -> int:
        """Fits to all pairs, and to those without each fold."""
        return sum(fit.work.runs for fit in self.fits)

    @property
    def predicted_s(self) -> float:
        """Processor seconds of all its work, at most."""
        return predicted_s([fit.work for fit in self.fits])


def plan_request(body: CalibrationTemplate, sources: Sequence[CameraPairs]) -> CalibrationPlan:
    """Check a request against its rig and pairs, and resolve what each fit is to do.

    Raises:
        DocumentError, Problem: 422 of the functions of :mod:`service.calibrations.resolve`, of
            :func:`~service.calibrations.work_rules.check_work`, and ``too_few_pairs``.
    """
    template = resolve_template(body)
    cameras = resolve_cameras(template, sources)
    work = _work(template, cameras)
    check_work(work, template.schedule)
    resolved = [(camera, fit) for camera in cameras for fit in resolve_fits(template, camera)]
    digest = _digest(template, cameras, [fit for _, fit in resolved])
    seed = body.seed if body.seed is not None else int(digest[:13], 16)  # 52 bits
    notes = [note for camera in cameras for note in camera.notes(template)]
    folds: dict[str, dict[str, int]] = {}
    for camera in cameras:
        free = {fit.model: _free(camera, fit) for fitted, fit in resolved if fitted is camera}
        folds[camera.name], sentences = fold_count(camera.pairs.columns, body.folds, free, camera.name)
        notes += sentences
    fits: list[FitPlan] = []
    for (camera, fit), of_fit in zip(resolved, work, strict=False):
        notes += weighing_note(camera.name, fit.weights)
        count = folds[camera.name][fit.model]
        complete = fit.model_copy(update={"seed": seed, "folds": count})
        fits.append(FitPlan(camera, complete, of_fit._replace(runs=1 + count)))
    request = body.model_dump(mode="json") | {"models": template.models, "seed": seed}
    # What the preset means where the request names nothing is alike in all fits.
    request |= {name: getattr(fit, name) for _, fit in resolved[:1] for name in _OF_PRESET}
    return CalibrationPlan(fits, digest, request, list(dict.fromkeys(notes)))


def _work(template: ResolvedTemplate, cameras: Sequence[ResolvedCamera]) -> list[FitWork]:
    """What each fit costs. A template without cameras is looked at as for a camera without pairs."""
    fits: list[tuple[str, ModelName, int]] = [
        (camera.name, model, camera.pairs.count) for camera in cameras for model in camera.models
    ]
    return [
        FitWork(camera, model, pairs, 1 + template.request.folds, run_cost(model, pairs, template.schedule))
        for camera, model, pairs in fits or [("", model, 0) for model in template.models]
    ]


def _digest(template: ResolvedTemplate, cameras: Sequence[ResolvedCamera], fits: Sequence[FitRequest]) -> str:
    return content_hash(
        {
            "folds": template.request.folds,
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
        raise unprocessable(
            "too_few_pairs",
            f"{camera.name} has {pairs} {noun}, and {fit.model} has {free} free parameters.",
            "Mark more corners, state the lens (--intrinsics FILE, or on the recording's page), or ask for a "
            "smaller model.",
            pairs=pairs,
            free_parameters=free,
        )
    return free
