"""A calibration request planned: its terms, its cameras, the solver's documents, their seed, the fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.camera_models import ModelName, parameter_names
from apexcal.documents.schedules import Schedule
from service.calibrations.cameras import CameraPairs, ResolvedCamera, resolve_cameras
from service.calibrations.fit_documents import fit_document
from service.calibrations.fold_rules import fold_count
from service.calibrations.lock_rules import check_camera_locks
from service.calibrations.terms import Terms, resolve_terms
from service.calibrations.weight_rules import weighing_note
from service.calibrations.work_rules import Wanted, check_work, cost_of, predicted_s
from service.db.base import Json
from service.db.digests import content_hash
from service.http.problems import Problem
from service.jobs.costs import RunCost


@dataclass(frozen=True)
class FitPlan:
    """One model on one camera's pairs; ``folds`` blocks are held out in turn, besides the fit to all pairs.

    ``problem`` is the solver's document; ``cost`` is that of one run.
    """

    camera: ResolvedCamera
    model: ModelName
    folds: int
    problem: Json
    cost: RunCost


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
    """Check a request against its rig and pairs, and write out what the solver is to do.

    Raises:
        DocumentError, Problem: 422 of :func:`~service.calibrations.terms.resolve_terms`,
            :func:`~service.calibrations.cameras.resolve_cameras`,
            :func:`~service.calibrations.work_rules.check_work`, ``locked_out_of_bounds``, ``no_covariances`` and
            ``too_few_pairs``.
    """
    terms = resolve_terms(wanted)
    cameras = resolve_cameras(terms, sources)
    fitted: list[tuple[ResolvedCamera, ModelName]] = [
        (camera, model) for camera in cameras for model in camera.models
    ]
    work = _work(terms, fitted)
    check_work(work, terms.schedule)
    for camera in cameras:
        of_lens = camera.lens.locks_besides(terms.named) if camera.lens else {}
        check_camera_locks(terms.common["locked"], of_lens, terms.bounds, camera.camera, camera.bounds, terms.common)
    documents = [fit_document(terms, camera, model) for camera, model in fitted]
    digest = _digest(terms, cameras, documents)
    seed = terms.seed if terms.seed is not None else int(digest[:13], 16)  # 52 bits
    notes = [note for camera in cameras for note in camera.notes(terms)]
    folds: dict[str, dict[str, int]] = {}
    for camera in cameras:
        free = {
            doc["model"]: _free(camera, doc) for (one, _), doc in zip(fitted, documents, strict=True) if one is camera
        }
        folds[camera.name], sentences = fold_count(camera.pairs.columns, terms.folds, free, camera.name)
        notes += sentences
    fits: list[FitPlan] = []
    for (camera, model), document, one in zip(fitted, documents, work, strict=False):
        notes += weighing_note(camera.name, document)
        count = folds[camera.name][model]
        fits.append(FitPlan(camera, model, count, document | {"seed": seed, "folds": count}, one.cost))
    resolved = {"models": terms.models, "seed": seed}
    resolved |= {key: terms.common[key] for key in ("search", "bounds_preset", "loss", "outliers")}
    request = wanted.model_dump(mode="json") | resolved
    return CalibrationPlan(fits, terms.schedule, digest, request, list(dict.fromkeys(notes)))


def _work(terms: Terms, fitted: Sequence[tuple[ResolvedCamera, ModelName]]) -> list[Wanted]:
    """What each fit costs. A template without cameras is looked at as for a camera without pairs."""
    asked: list[tuple[str, ModelName, int]] = [(camera.name, model, camera.pairs.count) for camera, model in fitted]
    asked = asked or [("", model, 0) for model in terms.models]
    return [
        Wanted(camera, model, pairs, 1 + terms.folds, cost_of(model, pairs, terms.schedule))
        for camera, model, pairs in asked
    ]


def _digest(terms: Terms, cameras: Sequence[ResolvedCamera], documents: Sequence[Json]) -> str:
    return content_hash(
        {
            "folds": terms.folds,
            "fits": documents,
            # Not the sets' own hashes, which say where the pairs came from too: the same pairs give the same bits.
            "pairs": {camera.name: content_hash(camera.pairs.columns) for camera in cameras},
        }
    )


def _free(camera: ResolvedCamera, document: Json) -> int:
    """The number of free parameters. Raises Problem 422 ``too_few_pairs``, there are fewer pairs."""
    model = document["model"]
    free = len(parameter_names(model, document["search"])) - len(document["locked"])
    pairs = camera.pairs.count
    if pairs < max(free, 1):
        noun = "pair" if pairs == 1 else "pairs"
        raise Problem(
            422,
            "too_few_pairs",
            f"{camera.name} has {pairs} {noun}, and {model} has {free} free parameters.",
            "Mark more vertices, or lock what is known (intrinsics, lever arm), or ask for a smaller model.",
            pairs=pairs,
            free_parameters=free,
        )
    return free
