"""What a request asks of all its fits, with everything filled in that it leaves to its preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from apexcal.documents.bounds import Interval
from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.camera_models import ModelName, parse_model
from apexcal.documents.rules import LensUse, WeightRule
from apexcal.documents.schedules import PRESETS, Schedule
from service.calibrations.lenses import Lens, as_stated, take_over
from service.calibrations.lock_rules import check_locks
from service.calibrations.parameter_rules import check_names, check_order
from service.db.base import Json


@dataclass(frozen=True)
class Terms:
    """A request without its cameras, checked as far as that goes without them.

    ``lenses`` are those that the request gives, by camera. ``bounds`` are the request's own. ``common`` are the
    members that the solver's documents of all fits share; ``locked`` and ``priors`` are two of them.
    """

    models: list[ModelName]
    schedule: Schedule
    folds: int
    seed: int | None
    weights: WeightRule
    common_errors: Json
    use_as: LensUse
    lenses: Mapping[str, Lens]
    bounds: Mapping[str, Interval]
    common: Json

    @property
    def settled(self) -> set[str]:
        """Parameters that the request itself bounds or locks."""
        return {*self.bounds, *self.common["locked"]}

    @property
    def named(self) -> set[str]:
        """Parameters of which the request itself says something."""
        return self.settled | set(self.common["priors"])


def resolve_terms(wanted: CalibrationTemplate) -> Terms:
    """Check what can be checked without a camera.

    Raises:
        DocumentError: ``unknown_model``.
        Problem: 422 ``unknown_parameter``, ``bounds_inside_out``, ``locked_out_of_bounds``, and of the given lenses
            those of :func:`~service.calibrations.lenses.as_stated` and ``intrinsics_of_another_model``.
    """
    models: list[ModelName] = list(dict.fromkeys(parse_model(name) for name in wanted.models))
    schedule = replace(PRESETS[wanted.preset].schedule, **wanted.schedule.model_dump(exclude_none=True))
    common = _common(wanted, models, schedule)
    bounds = check_names(wanted.bounds, "bounds", models, common["search"])
    check_order(bounds)
    check_locks(common["locked"], bounds)
    lenses = {
        camera: take_over(camera, as_stated(camera, given.model_dump()), models, wanted.intrinsics_as)
        for camera, given in wanted.intrinsics.items()
    }
    return Terms(
        models=models,
        schedule=schedule,
        folds=wanted.folds,
        seed=wanted.seed,
        weights=wanted.weights,
        common_errors=wanted.common_errors.model_dump(exclude_none=True),
        use_as=wanted.intrinsics_as,
        lenses=lenses,
        bounds=bounds,
        common=common,
    )


def _common(wanted: CalibrationTemplate, models: list[ModelName], schedule: Schedule) -> Json:
    preset = PRESETS[wanted.preset]
    search = wanted.search or preset.search
    priors = {name: prior.model_dump() for name, prior in wanted.priors.items()}
    return {
        "search": search,
        "rotation_range_deg": wanted.rotation_range_deg,
        "bounds_preset": wanted.bounds_preset or preset.bounds,
        **({"line_time_us": wanted.line_time_us} if wanted.line_time_us else {}),
        "loss": wanted.loss or preset.loss,
        "outliers": wanted.outliers or preset.outliers,
        "preset": wanted.preset,
        # Written out, so that the jobs are cut for exactly the slots that the solver runs. No more than that: the
        # seed follows from this document.
        "schedule": {
            "slots": schedule.slots,
            "population": schedule.population,
            "generations": schedule.generations,
        }
        | wanted.schedule.model_dump(exclude_none=True),
        "locked": check_names(wanted.locked, "locked", models, search),
        "priors": check_names(priors, "priors", models, search),
    }
