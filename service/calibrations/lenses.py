"""What is known of a camera's lens before its calibration, as bounds, priors or locks of the solver's parameters.

A stated lens is ``{"model", "K" (9 numbers, rows), "D", "width", "height"}`` with the model by our name: the form in
which a recording's CameraInfo is kept. Coefficients have OpenCV's order, which is that of our parameters:
``brown_conrady`` k1 k2 p1 p2 k3, ``kannala_brandt`` k1 k2 k3 k4, ``rational_polynomial`` k1 k2 p1 p2 k3 k4 k5 k6.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from apexcal.documents.camera_models import ModelName, parameter_names
from apexcal.documents.lenses import check_lens, parameters_of, stated_deviation
from apexcal.documents.rules import LensUse
from service.platform.db.base import Json
from service.platform.db.fleets import RigCamera
from service.platform.http.problems import unprocessable

# With fewer degrees of freedom pairs do not tell how large their own errors are (`workers/judge/pair_checks.py`), and
# so not whether a lens is better than the stated one.
_LEAST_FREEDOM = 50
# How far a stated focal length may be off, as a share of itself, and a principal point, as a share of the image.
_FOCAL_SHARE = 0.10
_CENTRE_SHARE = 0.05


@dataclass(frozen=True)
class Known:
    """The part of a solver's document that a stated lens gives one model, in pixels."""

    bounds: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    priors: dict[str, Json] = field(default_factory=dict[str, Json])
    locked: dict[str, float] = field(default_factory=dict[str, float])


def as_stated(camera: str, intrinsics: Json) -> Json:
    """A lens as people send it, under our model's name.

    Raises:
        DocumentError: ``unknown_distortion_model``, ``distortion_without_equal``, ``invalid_intrinsics``.
    """
    K, stated = ([float(value) for value in intrinsics[name]] for name in "KD")
    model, D = check_lens(camera, str(intrinsics["distortion_model"]), K, stated)
    return {"model": model, "K": K, "D": D, "width": intrinsics["width"], "height": intrinsics["height"]}


def is_of_images(stated: Json, camera: RigCamera) -> bool:
    """Whether intrinsics are of images of the camera's size."""
    return (stated["width"], stated["height"]) == (camera.image_width, camera.image_height)


def check_size(stated: Json, camera: RigCamera, what: str) -> None:
    """Refuse intrinsics of other images than the camera's.

    Raises:
        Problem: 422 ``intrinsics_of_another_size``, ``intrinsics_of_raw_images``.
    """
    if not is_of_images(stated, camera):
        raise unprocessable(
            "intrinsics_of_another_size",
            f"{what} for {stated['width']} x {stated['height']} pixels, "
            f"and its images have {camera.image_width} x {camera.image_height}.",
            "Leave them out, scale them to the images' size, or give bounds.",
        )
    if camera.images and camera.images["kind"] == "rectified" and any(stated["D"]):
        raise unprocessable(
            "intrinsics_of_raw_images",
            f"{what} with a distortion, and its images are rectified.",
            "Give P[:, :3] of the CameraInfo as K, without D, or correct what the rig says of its images.",
        )


@dataclass(frozen=True)
class LensConstraints:
    """A stated lens, and what it says of the parameters of each fitted model: ``by_model``, in their order."""

    stated: Json
    use_as: LensUse
    by_model: Mapping[ModelName, Known]

    @property
    def parameters(self) -> Json | None:
        """The lens itself, as ``stated_lens`` of the solver's document, or why it is not used."""
        model: ModelName | None = self.stated["model"]
        if model is None:
            what, count = self.stated.get("distortion_model"), len(self.stated["D"])
            return {"unused": f"no model here is {what!r} with {count} coefficients"}
        values = parameters_of(self.stated, model) if model else None
        return values and {"model": model, **values}


def take_over(
    camera: str, stated: Json, models: Sequence[ModelName], use_as: LensUse, pairs: int | None = None
) -> LensConstraints:
    """The lens as the models take it over. If it is locked, those that cannot be it are left out.

    ``pairs``: how many there are, or groups of them, which says what ``auto`` is; None where no camera is known yet.

    Raises:
        Problem: 422 ``intrinsics_of_another_model`` where none is left.
    """
    if use_as == "auto":
        use_as = "locked" if _is_locked(stated, models, pairs) else "prior"
    priors: dict[ModelName, Known] = {
        model: prior for model in models if (prior := _known_of(stated, model, use_as)) is not None
    }
    if priors:
        return LensConstraints(stated, use_as, priors)
    lens = stated["model"]
    what = f"are of {lens}" if lens else f"({stated.get('distortion_model')}) are of a model that has no equal here"
    raise unprocessable(
        "intrinsics_of_another_model",
        f"The intrinsics of {camera} {what}, and {' and '.join(models)} cannot take them over.",
        (f"Ask for {lens}, or take" if lens else "Take") + " focal lengths and centre alone "
        "(intrinsics_as: bounds; --intrinsics-as bounds).",
    )


def lens_notes(lens: LensConstraints, models: Sequence[ModelName], settled: Collection[str]) -> list[str]:
    """What became of a lens. ``settled`` are the parameters that the request or the rig bounds or locks."""
    if lens.use_as == "bounds":
        return [_bounds_note(lens.stated, settled)]
    if lens.use_as == "free":
        return ["the lens is fitted, and compared with the stated one."]
    locks = lens.use_as == "locked"
    rest = [model for model in models if lens.by_model.get(model, Known()) == Known()]
    notes = [f"the lens {'is' if locks else 'stays near'} the stated one."] if rest != models else []
    if rest:
        verb, ways = ("is", "its own lens") if len(rest) == 1 else ("are", "their own lenses")
        what = f"{verb} left out" if locks else f"{verb} fitted with {ways}"
        of = lens.stated["model"] or f"of a model without equal here ({lens.stated.get('distortion_model')})"
        notes.append(f"{' and '.join(rest)} {what}, for the stated lens is {of}.")
    return notes


def _is_locked(stated: Json, models: Sequence[ModelName], pairs: int | None) -> bool:
    """Whether there are too few pairs to refine a lens that one of the models can be."""
    if pairs is None or not any(parameters_of(stated, model) for model in models):
        return False
    return 2 * pairs - len(parameter_names(stated["model"], "rotation_vector")) < _LEAST_FREEDOM


def _bounds_note(stated: Json, settled: Collection[str]) -> str:
    names = [name for name in _near_stated(stated) if name not in settled]
    if not names:
        return "the stated intrinsics bound nothing, because the rig or the request settles it all."
    listed = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    return f"{listed} {'is' if len(names) == 1 else 'are'} looked for near what is stated."


def _known_of(stated: Json, model: ModelName, use_as: LensUse) -> Known | None:
    """What a stated lens says of a model's parameters; None where it is locked and the model cannot be it.

    As bounds only focal lengths and centre count, which every model has. As priors and locks the distortion counts
    too: a lens without any is a pinhole's as well as ``brown_conrady``'s.
    """
    if use_as == "bounds":
        return Known(bounds=_near_stated(stated))
    values = None if use_as == "free" else parameters_of(stated, model)
    if use_as == "locked":
        return None if values is None else Known(locked=values)
    if values is None:
        return Known()
    if values.get("skew") == 0.0:
        del values["skew"]  # as every lens without one
    priors: dict[str, Json] = {
        name: {"mean": value, "sigma": stated_deviation(stated["model"], name, value, stated["width"])}
        for name, value in values.items()
    }
    return Known(priors=priors)


def _near_stated(stated: Json) -> dict[str, list[float]]:
    """Bounds about the stated focal lengths and principal point, pixels."""
    f_x, _, c_x, _, f_y, c_y = stated["K"][:6]
    across, down = _CENTRE_SHARE * stated["width"], _CENTRE_SHARE * stated["height"]
    return {
        "f_x": [f_x * (1.0 - _FOCAL_SHARE), f_x * (1.0 + _FOCAL_SHARE)],
        "f_y": [f_y * (1.0 - _FOCAL_SHARE), f_y * (1.0 + _FOCAL_SHARE)],
        "c_x": [c_x - across, c_x + across],
        "c_y": [c_y - down, c_y + down],
    }
