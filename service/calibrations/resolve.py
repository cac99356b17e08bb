"""Turns a calibration template and the cameras of a rig into one `FitRequest` for each camera and model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from apexcal.documents.bounds import Interval
from apexcal.documents.calibrations import CalibrationTemplate
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
from apexcal.documents.fit_requests import FitRequest, fit_request, in_radians
from apexcal.documents.schedules import PRESETS, Schedule, schedule_of
from apexcal.geometry.image_frames import T_images_camera
from service.calibrations.lenses import Known, LensConstraints, as_stated, check_size, lens_notes, take_over
from service.calibrations.pair_rules import common_errors, weighing
from service.calibrations.parameter_rules import check_camera_locks, check_locks, check_names, check_order
from service.platform.db.base import Json
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import RigCamera
from service.platform.http.problems import unprocessable


@dataclass(frozen=True)
class CameraPairs:
    """A camera of the rig and the set that it is calibrated from.

    ``stated`` is what the recording says of the camera's intrinsics, where the request starts from that.
    """

    camera: RigCamera
    pairs: CorrespondenceSet
    stated: Json | None = None


@dataclass(frozen=True)
class ResolvedTemplate:
    """A template without open choices, checked as far as that goes without cameras.

    Bounds, locks and priors go by the parameters' own names, in radians. ``lenses`` are the request's own, by camera.
    """

    request: CalibrationTemplate
    models: list[ModelName]
    search: SearchForm
    schedule: Schedule
    bounds: Mapping[str, Interval]
    locked: Mapping[str, float]
    priors: Mapping[str, Json]
    lenses: Mapping[str, LensConstraints]

    @property
    def named(self) -> set[str]:
        """Parameters that the request itself bounds, locks or gives a prior."""
        return {*self.bounds, *self.locked, *self.priors}


@dataclass(frozen=True)
class ResolvedCamera:
    """A camera that a request calibrates. ``models`` are those of the request's that can be its lens."""

    camera: RigCamera
    pairs: CorrespondenceSet
    lens: LensConstraints | None
    models: Sequence[ModelName]

    @property
    def name(self) -> str:
        """The camera's name in its rig."""
        return self.camera.name

    def notes(self, template: ResolvedTemplate) -> list[str]:
        """Notes for people: on its set, on bounds of the rig that were not used, and on its lens."""
        parameters = {name for form in EXTRINSICS for name in all_names(MODELS, form)}
        unused = [name for name in self.camera.bounds if bare_name(name) not in parameters]
        notes = [f"{self.name}: {note}" for note in self.pairs.notes]
        notes += [f"The rig's bounds of {self.name} name {n!r}, which no model has; unused." for n in unused]
        if self.lens:
            settled = {*template.bounds, *template.locked, *self.camera.bounds}
            notes += [f"{self.name}: {note}" for note in lens_notes(self.lens, template.models, settled)]
        return notes


def resolve_template(body: CalibrationTemplate) -> ResolvedTemplate:
    """Check what can be checked without a camera.

    Raises:
        DocumentError: ``unknown_model``.
        Problem: 422 ``unknown_parameter``, ``bounds_inside_out``, ``locked_out_of_bounds``, and of the given lenses
            those of :func:`~service.calibrations.lenses.as_stated` and ``intrinsics_of_another_model``.
    """
    models: list[ModelName] = list(dict.fromkeys(parse_model(name) for name in body.models))
    preset = PRESETS[body.preset]
    search = body.search or preset.search
    schedule = schedule_of(preset, body.schedule.model_dump(exclude_none=True))
    locked = check_names(body.locked, "locked", models, search)
    priors = check_names({name: prior.model_dump() for name, prior in body.priors.items()}, "priors", models, search)
    bounds = check_names(body.bounds, "bounds", models, search)
    check_order(bounds)
    check_locks(locked, bounds)
    stated = {camera: as_stated(camera, lens.model_dump()) for camera, lens in body.intrinsics.items()}
    lenses = {
        camera: take_over(camera, lens, _with_own(body, models, lens), body.intrinsics_as)
        for camera, lens in stated.items()
    }
    return ResolvedTemplate(body, models, search, schedule, bounds, locked, priors, lenses)


def _with_own(body: CalibrationTemplate, models: list[ModelName], stated: Json) -> list[ModelName]:
    """The models of a request, and that of the stated lens too where the request names none."""
    own: ModelName | None = stated["model"]
    return models if "models" in body.model_fields_set or own is None or own in models else [*models, own]


def resolve_cameras(template: ResolvedTemplate, sources: Sequence[CameraPairs]) -> list[ResolvedCamera]:
    """The cameras with their lenses. What the request gives goes before what a recording says.

    Raises:
        Problem: 422 ``unknown_camera``, ``intrinsics_of_another_size``, ``intrinsics_of_another_model``.
    """
    cameras = [source.camera.name for source in sources]
    strangers = sorted(set(template.lenses) - set(cameras))
    if cameras and strangers:
        raise unprocessable(
            "unknown_camera",
            f"intrinsics names {strangers[0]!r}, of which there are no pairs in this request.",
            f"Its cameras are {', '.join(cameras)}.",
            cameras=cameras,
        )
    return [_camera(template, source) for source in sources]


def _camera(template: ResolvedTemplate, source: CameraPairs) -> ResolvedCamera:
    camera = source.camera
    lens = template.lenses.get(camera.name)
    if lens is not None:
        check_size(lens.stated, camera, f"The intrinsics of {camera.name} are")
    stated = lens.stated if lens else source.stated
    if stated is not None:
        models = _with_own(template.request, template.models, stated)
        # Corners of one pose err together: they tell no more of a lens than one does.
        independent = len(set(source.pairs.columns.get("group", ()))) or source.pairs.count
        lens = take_over(camera.name, stated, models, template.request.intrinsics_as, independent)
    models = template.models if lens is None else list(lens.by_model)
    return ResolvedCamera(camera, source.pairs, lens, models)


def resolve_fits(template: ResolvedTemplate, camera: ResolvedCamera) -> list[FitRequest]:
    """The camera's requests, one for each of its models; the seed is 0 and nothing is held out.

    Raises:
        Problem: 422 ``locked_out_of_bounds``, ``no_covariances``, ``no_motion``.
    """
    rig = in_radians(camera.camera.bounds)
    fits = [_fit(template, camera, model, rig) for model in camera.models]
    for fit in fits:
        check_camera_locks(fit, template.locked, template.bounds, rig)
    return fits


def _fit(
    template: ResolvedTemplate, camera: ResolvedCamera, model: ModelName, rig: Mapping[str, Interval]
) -> FitRequest:
    """The request with only the parameters that this model has.

    The template's statements about a parameter go before the known lens; the rig's bounds go before the lens's
    bounds. Skew is 0 unless anyone names it. Table I of the paper leaves it open.
    """
    body, named = template.request, template.named
    names = parameter_names(model, template.search)
    stated = camera.lens.by_model[model] if camera.lens else Known()

    def of_model(values: Mapping[str, object]) -> Json:
        return {name: value for name, value in values.items() if name in names}

    def unnamed(values: Mapping[str, object]) -> Json:
        return {name: value for name, value in values.items() if name not in named}

    bounds = stated.bounds | of_model(rig)
    preset = body.bounds_preset or PRESETS[body.preset].bounds
    skews = "skew" in names and preset != "paper-table-1" and "skew" not in {*named, *bounds, *stated.priors}
    return camera_request(
        camera.camera,
        model,
        preset=body.preset,
        search=template.search,
        bounds_preset=preset,
        rotation_range_deg=body.rotation_range_deg,
        bounds=bounds | of_model(template.bounds),
        locked=({"skew": 0.0} if skews else {}) | unnamed(stated.locked) | of_model(template.locked),
        priors=unnamed(stated.priors) | of_model(template.priors),
        loss=body.loss,
        outliers=body.outliers,
        weights=weighing(camera.name, camera.pairs.columns, body.weights),
        common_errors=common_errors(camera.pairs, body.common_errors.model_dump(exclude_none=True)),
        line_time_us=body.line_time_us,
        stated_lens=camera.lens and camera.lens.parameters,
        schedule=body.schedule.model_dump(exclude_none=True),
    )


def camera_request(
    camera: RigCamera, model: ModelName, search: SearchForm = "rotation_vector", **options: Any
) -> FitRequest:
    """The request of a camera as its rig describes it.

    ``options``: of ``fit_request``; without ``bounds`` the rig's hold.
    """
    frame = T_images_camera(camera.nominal["to_frame"], camera.images)["to_frame"]
    of_rig = in_radians(camera.bounds)
    names = parameter_names(model, search)
    fields: Json = {"bounds": {name: value for name, value in of_rig.items() if name in names}, **options}
    size = (camera.image_width, camera.image_height)
    return fit_request(model, size, camera.nominal | {"to_frame": frame}, camera=camera.name, search=search, **fields)
