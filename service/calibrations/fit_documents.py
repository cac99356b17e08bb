"""The solver's document of one model on one camera."""

from __future__ import annotations

from apexcal.documents.camera_models import ModelName, SearchForm, parameter_names
from service.calibration_runs.image_frames import T_images_camera
from service.calibrations.cameras import ResolvedCamera
from service.calibrations.common_error_rules import common_errors
from service.calibrations.lenses import Known
from service.calibrations.parameter_rules import in_radians
from service.calibrations.terms import Terms
from service.calibrations.weight_rules import weighing
from service.db.base import Json
from service.db.fleets import RigCamera


def fit_document(terms: Terms, camera: ResolvedCamera, model: ModelName) -> Json:
    """The document with only the parameters that this model has.

    What the request says of a parameter goes before what is known of the lens; the rig's bounds go before its bounds.

    Raises:
        Problem: as :func:`~service.calibrations.weight_rules.weighing`.
    """
    common, asked = terms.common, terms.named
    names = parameter_names(model, common["search"])
    described = describe_camera(camera.camera, model, common["search"])
    known = camera.lens.known[model] if camera.lens else Known()
    parameters = {
        "bounds": known.bounds
        | described["bounds"]
        | {name: list(value) for name, value in terms.bounds.items() if name in names},
        "locked": {name: value for name, value in known.locked.items() if name not in asked}
        | {name: value for name, value in common["locked"].items() if name in names},
        "priors": {name: value for name, value in known.priors.items() if name not in asked}
        | {name: value for name, value in common["priors"].items() if name in names},
    }
    stated = weighing(camera.name, camera.pairs.pairs, terms.weights) | common_errors(
        camera.pairs, terms.common_errors
    )
    return common | described | parameters | stated


def describe_camera(camera: RigCamera, model: ModelName, search: SearchForm) -> Json:
    """The part of the solver's document that the rig tells, with the bounds that this model has."""
    names = parameter_names(model, search)
    frame = T_images_camera(camera.nominal["to_frame"], camera.images)["to_frame"]
    return {
        "model": model,
        "camera": camera.name,
        "image_size": [camera.image_width, camera.image_height],
        "nominal": camera.nominal | {"to_frame": frame},
        "bounds": {name: value for name, value in in_radians(camera.bounds).items() if name in names},
    }
