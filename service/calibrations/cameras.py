"""The cameras that a request calibrates, each with its pairs and what is known of its lens."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from apexcal.documents.camera_models import FOCAL_AND_CENTRE, ModelName
from apexcal.documents.rules import LensUse
from service.calibrations.known_lens import as_stated, known_lens, near_stated
from service.calibrations.lens_queries import check_size
from service.calibrations.schemas import GivenLens
from service.db.base import Json
from service.db.calibrations import CorrespondenceSet
from service.db.fleets import RigCamera
from service.http.problems import Problem


@dataclass(frozen=True)
class CameraPairs:
    """A camera of the rig and the set that it is calibrated from.

    ``stated`` is what the recording says of the camera's intrinsics, where the request starts from that, or what the
    request gives (see :mod:`service.calibrations.known_lens`).
    """

    camera: RigCamera
    pairs: CorrespondenceSet
    stated: Json | None = None


def with_given_lenses(sources: Sequence[CameraPairs], given: Mapping[str, GivenLens]) -> list[CameraPairs]:
    """The cameras with the lenses that the request gives; what it gives goes before what a recording says.

    Raises:
        Problem: 422 ``unknown_camera``, ``intrinsics_of_another_size``, and those of ``as_stated``.
    """
    cameras = [source.camera.name for source in sources]
    strangers = sorted(set(given) - set(cameras)) if cameras else []
    if strangers:
        raise Problem(
            422,
            "unknown_camera",
            f"intrinsics names {strangers[0]!r}, of which there are no pairs in this request.",
            f"Its cameras are {', '.join(cameras)}.",
            cameras=cameras,
        )
    return [_with(source, given[source.camera.name]) if source.camera.name in given else source for source in sources]


def check_given_lenses(given: Mapping[str, GivenLens], models: Sequence[ModelName], use_as: LensUse) -> None:
    """Refuse lenses that are wrong whatever the rig: as ``as_stated``, and 422 ``intrinsics_of_another_model``."""
    for name, lens in given.items():
        _able(name, as_stated(name, lens.model_dump()), models, use_as)


def _with(source: CameraPairs, given: GivenLens) -> CameraPairs:
    name = source.camera.name
    stated = as_stated(name, given.model_dump())
    check_size(stated, source.camera, f"The intrinsics of {name} are")
    return replace(source, stated=stated)


def models_of(source: CameraPairs, models: Sequence[ModelName], use_as: LensUse) -> list[ModelName]:
    """Those of the models that can be the camera's lens.

    Raises:
        Problem: 422 ``intrinsics_of_another_model`` where none can.
    """
    return list(models) if source.stated is None else _able(source.camera.name, source.stated, models, use_as)


def locked_by_lens(
    source: CameraPairs, models: Sequence[ModelName], use_as: LensUse, asked: Collection[str]
) -> dict[str, float]:
    """Focal lengths and principal point (pixels) at which the camera's stated lens holds them, where it locks any.

    Those in ``asked`` are the request's own. The distortion is not among them: any may be right that was measured.
    """
    if source.stated is None or use_as != "locked":
        return {}
    known = known_lens(source.stated, models_of(source, models, use_as)[0], use_as)
    locked = known.locked if known else {}
    return {name: locked[name] for name in FOCAL_AND_CENTRE if name in locked and name not in asked}


def _able(camera: str, stated: Json, models: Sequence[ModelName], use_as: LensUse) -> list[ModelName]:
    able: list[ModelName] = [model for model in models if known_lens(stated, model, use_as) is not None]
    if able:
        return able
    lens = stated["model"]
    what = f"are of {lens}" if lens else f"({stated.get('distortion_model')}) are of a model that has no equal here"
    raise Problem(
        422,
        "intrinsics_of_another_model",
        f"The intrinsics of {camera} {what}, and {' and '.join(models)} cannot take them over.",
        (f"Ask for {lens}, or take" if lens else "Take") + " focal lengths and centre alone "
        "(intrinsics_as: bounds; --intrinsics-as bounds).",
    )


def lens_notes(source: CameraPairs, models: Sequence[ModelName], use_as: LensUse, settled: set[str]) -> list[str]:
    """What became of a stated lens. ``settled`` are the parameters that the request itself bounds or locks."""
    if source.stated is None:
        return []
    name = source.camera.name
    if use_as == "bounds":
        return [f"{name}: {_near_stated(source.stated, settled | set(source.camera.bounds))}"]
    able = models_of(source, models, use_as)
    rest = [model for model in models if model not in able]
    how = "locked at" if use_as == "locked" else "drawn to"
    notes = [f"{name}: the intrinsics are {how} those stated."]
    if rest:
        verb = "is" if len(rest) == 1 else "are"
        notes.append(
            f"{name}: {' and '.join(rest)} {verb} left out, for the stated lens is {source.stated['model']}."
        )
    return notes


def _near_stated(stated: Json, settled: set[str]) -> str:
    """Which parameters are looked for near what is stated; the rig and the request go first."""
    names = [name for name in near_stated(stated) if name not in settled]
    if not names:
        return "the stated intrinsics bound nothing, because the rig or the request settles it all."
    listed = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    return f"{listed} {'is' if len(names) == 1 else 'are'} looked for near what is stated."
