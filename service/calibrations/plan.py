"""A calibration request checked and turned into the documents that the solver reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import radians
from typing import Any

from apexcal.documents.bounds import BoundsPreset, Interval
from apexcal.documents.camera_models import (
    EXTRINSICS,
    MODELS,
    ModelName,
    SearchForm,
    all_names,
    bare_name,
    parameter_names,
    parse_model,
)
from apexcal.documents.rules import LensUse
from apexcal.documents.schedules import PRESETS, Schedule
from service.calibrations.cameras import (
    CameraPairs,
    check_given_lenses,
    lens_notes,
    locked_by_lens,
    models_of,
    with_given_lenses,
)
from service.calibrations.fold_rules import fold_count
from service.calibrations.known_lens import Known, known_lens
from service.calibrations.lock_rules import check_camera_locks, check_locks
from service.calibrations.schemas import CalibrationTemplate
from service.calibrations.weight_rules import weighing, weighing_note
from service.calibrations.work_rules import Wanted, check_work, cost_of, predicted_s
from service.db.base import Json
from service.db.digests import content_hash
from service.db.fleets import RigCamera
from service.http.problems import Problem
from service.jobs.costs import RunCost


@dataclass(frozen=True)
class Fit:
    """One model on one camera's pairs; ``folds`` blocks are held out in turn, besides the fit to all pairs.

    ``cost`` is that of one run.
    """

    source: CameraPairs
    model: ModelName
    folds: int
    problem: Json
    cost: RunCost


@dataclass(frozen=True)
class Plan:
    """Everything that a request comes to."""

    fits: list[Fit]
    size: Schedule
    content_hash: str
    request: Json
    notes: list[str]

    @property
    def predicted_s(self) -> float:
        """Processor seconds of all its work, at most."""
        return predicted_s(
            Wanted(fit.source.camera.name, fit.model, fit.source.pairs.count, 1 + fit.folds, fit.cost)
            for fit in self.fits
        )


def plan_request(wanted: CalibrationTemplate, sources: list[CameraPairs]) -> Plan:
    """Check a request against its rig and pairs, and write out what the solver is to do.

    Raises:
        Problem: 422 ``unknown_model``, ``unknown_parameter``, ``bounds_inside_out``, ``locked_out_of_bounds``,
            ``too_few_pairs``; of the lenses ``unknown_camera``, ``intrinsics_of_another_size``,
            ``intrinsics_of_another_model`` and those of :func:`~service.calibrations.known_lens.as_stated`;
            and those of :func:`~service.calibrations.work_rules.check_work`.
    """
    models: list[ModelName] = list(dict.fromkeys(parse_model(name) for name in wanted.models))
    size = _size(wanted)
    common = _common(wanted, models)
    bounds = _by_name(wanted.bounds, "bounds", models, common["search"])
    _check_order(bounds)
    check_locks(common["locked"], bounds)
    use_as = wanted.intrinsics_as
    check_given_lenses(wanted.intrinsics, models, use_as)
    sources = with_given_lenses(sources, wanted.intrinsics)
    runs = 1 + wanted.folds
    work = [
        Wanted(one.camera.name, model, one.pairs.count, runs, cost_of(model, one.pairs.count, size))
        for one in sources
        for model in models_of(one, models, use_as)
    ]
    # A template is checked as for a camera without pairs.
    check_work(work or [Wanted("", model, 0, runs, cost_of(model, 0, size)) for model in models], size)
    settled = {*bounds, *common["locked"]}
    for source in sources:
        of_lens = locked_by_lens(source, models, use_as, settled | set(common["priors"]))
        check_camera_locks(common["locked"], of_lens, bounds, source.camera, _bare(source.camera.bounds), common)
    weights = {
        source.camera.name: weighing(source.camera.name, source.pairs.pairs, wanted.weights) for source in sources
    }
    documents = [
        (source, _document(source, model, common, bounds, use_as) | weights[source.camera.name])
        for source in sources
        for model in models_of(source, models, use_as)
    ]
    digest = content_hash(
        {
            "folds": wanted.folds,
            "fits": [document for _, document in documents],
            # Not the sets' own hashes, which say where the pairs came from too: the same pairs give the same bits.
            "pairs": {source.camera.name: content_hash(source.pairs.pairs) for source in sources},
        }
    )
    seed = wanted.seed if wanted.seed is not None else int(digest[:13], 16)  # 52 bits
    notes = [note for source in sources for note in [*_notes(source), *lens_notes(source, models, use_as, settled)]]
    fits: list[Fit] = []
    for source, document in documents:
        notes += weighing_note(source.camera.name, document)
        folds, sentence = _folds(source, document, wanted.folds)
        notes += [sentence] if sentence else []
        cost = cost_of(document["model"], source.pairs.count, size)
        fits.append(Fit(source, document["model"], folds, document | {"seed": seed, "folds": folds}, cost))
    resolved = {"models": models, "seed": seed} | {key: common[key] for key in ("search", "bounds_preset")}
    return Plan(fits, size, digest, wanted.model_dump(mode="json") | resolved, list(dict.fromkeys(notes)))


def _common(wanted: CalibrationTemplate, models: list[ModelName]) -> Json:
    """What all fits of a request share, with everything filled in that the preset means."""
    paper, size = wanted.preset == "paper", _size(wanted)
    search: SearchForm = wanted.search or ("euler" if paper else "rotation_vector")
    bounds_preset: BoundsPreset = wanted.bounds_preset or ("paper-table-1" if paper else "image-size")
    priors = {name: prior.model_dump() for name, prior in wanted.priors.items()}
    return {
        "search": search,
        "rotation_range_deg": wanted.rotation_range_deg,
        "bounds_preset": bounds_preset,
        "loss": wanted.loss,
        "preset": wanted.preset,
        # Written out, so that the jobs are cut for exactly the slots that the solver runs. No more than that: the
        # seed follows from this document.
        "schedule": {"slots": size.slots, "population": size.population, "generations": size.generations}
        | wanted.schedule.model_dump(exclude_none=True),
        "locked": _by_name(wanted.locked, "locked", models, search),
        "priors": _by_name(priors, "priors", models, search),
        # The default is left out, so that a request from before this choice still gives the same seed and bits.
        **({} if wanted.outliers == "keep" else {"outliers": wanted.outliers}),
    }


def _size(wanted: CalibrationTemplate) -> Schedule:
    return replace(PRESETS[wanted.preset], **wanted.schedule.model_dump(exclude_none=True))


def _document(
    source: CameraPairs, model: ModelName, common: Json, asked_bounds: Mapping[str, Interval], use_as: LensUse
) -> Json:
    """The solver's document of one model on one camera, with only the parameters that this model has.

    What the request says of a parameter goes before what is known of the lens; the rig's bounds go before its bounds.
    """
    names = parameter_names(model, common["search"])
    described = describe_camera(source.camera, model, common["search"])
    known = known_lens(source.stated, model, use_as) if source.stated else None
    known = known or Known()
    asked = {name for part in (asked_bounds, common["locked"], common["priors"]) for name in part}
    return (
        common
        | described
        | {
            "bounds": known.bounds
            | described["bounds"]
            | {name: list(value) for name, value in asked_bounds.items() if name in names},
            "locked": {name: value for name, value in known.locked.items() if name not in asked}
            | {name: value for name, value in common["locked"].items() if name in names},
            "priors": {name: value for name, value in known.priors.items() if name not in asked}
            | {name: value for name, value in common["priors"].items() if name in names},
        }
    )


def describe_camera(camera: RigCamera, model: ModelName, search: SearchForm) -> Json:
    """The part of the solver's document that the rig tells, with the bounds that this model has."""
    names = parameter_names(model, search)
    return {
        "model": model,
        "camera": camera.name,
        "image_size": [camera.image_width, camera.image_height],
        "nominal": camera.nominal,
        "bounds": {bare: value for bare, value in _bare(camera.bounds).items() if bare in names},
    }


def _folds(source: CameraPairs, document: Json, wanted: int) -> tuple[int, str | None]:
    model = document["model"]
    free = len(parameter_names(model, document["search"])) - len(document["locked"])
    pairs = source.pairs.count
    if pairs < max(free, 1):
        noun = "pair" if pairs == 1 else "pairs"
        raise Problem(
            422,
            "too_few_pairs",
            f"{source.camera.name} has {pairs} {noun}, and {model} has {free} free parameters.",
            "Mark more vertices, or lock what is known (intrinsics, lever arm), or ask for a smaller model.",
            pairs=pairs,
            free_parameters=free,
        )
    return fold_count(source.pairs.pairs, wanted, free, f"{model} on {source.camera.name}")


def _notes(source: CameraPairs) -> list[str]:
    """What the set says of itself, and what of the rig's bounds is of no use."""
    known = {name for form in EXTRINSICS for name in all_names(MODELS, form)}
    unused = [name for name in source.camera.bounds if bare_name(name) not in known]
    return [f"{source.camera.name}: {note}" for note in source.pairs.notes] + [
        f"The rig's bounds of {source.camera.name} name {n!r}, which no model has; unused." for n in unused
    ]


def _by_name(given: Mapping[str, Any], where: str, models: Iterable[ModelName], search: SearchForm) -> dict[str, Any]:
    """Values by parameter name, angles in radians; every name must be a parameter of one of the models."""
    names = all_names(models, search)
    for name in given:
        if bare_name(name) not in names:
            raise Problem(
                422,
                "unknown_parameter",
                f"{where} names {name!r}, which is no parameter of {' or '.join(models)} in the form {search}.",
                f"The parameters are {', '.join(names)}; angles are in radians, or in degrees with _deg behind.",
                parameters=list(names),
            )
    bare = _bare(given)
    if len(bare) < len(given):
        raise Problem(
            422, "unknown_parameter", f"{where} names an angle twice, in radians and in degrees.", "Give it once."
        )
    return bare


def _check_order(bounds: Mapping[str, Interval]) -> None:
    for name, (low, high) in bounds.items():
        if not low < high:
            raise Problem(
                422,
                "bounds_inside_out",
                f"The bounds of {name} are inside out: the lower end {low:g} is not below the upper end {high:g}.",
                "Give them as [lower, upper]; a parameter that is known goes into `locked`.",
            )


def _bare(given: Mapping[str, Any]) -> dict[str, Any]:
    """The same values under the solver's names: what is given in degrees becomes radians."""
    return {bare_name(name): _radians(value) if bare_name(name) != name else value for name, value in given.items()}


def _radians(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: radians(number) for name, number in value.items()}
    if isinstance(value, list | tuple):
        return [radians(number) for number in value]
    return radians(value)
