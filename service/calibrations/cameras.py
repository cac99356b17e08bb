"""The cameras that a request calibrates, each with its pairs and what is known of its lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from apexcal.documents.bounds import Interval
from apexcal.documents.camera_models import EXTRINSICS, MODELS, ModelName, all_names, bare_name
from service.calibrations.lenses import Lens, check_size, lens_notes, take_over
from service.calibrations.parameter_rules import in_radians
from service.calibrations.terms import Terms
from service.db.base import Json
from service.db.calibrations import CorrespondenceSet
from service.db.fleets import RigCamera
from service.http.problems import Problem


@dataclass(frozen=True)
class CameraPairs:
    """A camera of the rig and the set that it is calibrated from.

    ``stated`` is what the recording says of the camera's intrinsics, where the request starts from that.
    """

    camera: RigCamera
    pairs: CorrespondenceSet
    stated: Json | None = None


@dataclass(frozen=True)
class ResolvedCamera:
    """A camera that a request calibrates. ``models`` are those of the request's that can be its lens.

    ``bounds`` are the rig's, in radians, metres and pixels.
    """

    camera: RigCamera
    pairs: CorrespondenceSet
    bounds: Mapping[str, Interval]
    lens: Lens | None
    models: Sequence[ModelName]

    @property
    def name(self) -> str:
        """The camera's name in its rig."""
        return self.camera.name

    def notes(self, terms: Terms) -> list[str]:
        """What its set says of itself, what of the rig's bounds is of no use, and what became of its lens."""
        known = {name for form in EXTRINSICS for name in all_names(MODELS, form)}
        unused = [name for name in self.camera.bounds if bare_name(name) not in known]
        notes = [f"{self.name}: {note}" for note in self.pairs.notes]
        notes += [f"The rig's bounds of {self.name} name {n!r}, which no model has; unused." for n in unused]
        if self.lens:
            settled = terms.settled | set(self.camera.bounds)
            notes += [f"{self.name}: {note}" for note in lens_notes(self.lens, terms.models, settled)]
        return notes


def resolve_cameras(terms: Terms, sources: Sequence[CameraPairs]) -> list[ResolvedCamera]:
    """The cameras with their lenses. What the request gives goes before what a recording says.

    Raises:
        Problem: 422 ``unknown_camera``, ``intrinsics_of_another_size``, ``intrinsics_of_another_model``.
    """
    cameras = [source.camera.name for source in sources]
    strangers = sorted(set(terms.lenses) - set(cameras)) if cameras else []
    if strangers:
        raise Problem(
            422,
            "unknown_camera",
            f"intrinsics names {strangers[0]!r}, of which there are no pairs in this request.",
            f"Its cameras are {', '.join(cameras)}.",
            cameras=cameras,
        )
    return [_resolve(terms, source) for source in sources]


def _resolve(terms: Terms, source: CameraPairs) -> ResolvedCamera:
    camera = source.camera
    lens = terms.lenses.get(camera.name)
    if lens is not None:
        check_size(lens.stated, camera, f"The intrinsics of {camera.name} are")
    elif source.stated is not None:
        lens = take_over(camera.name, source.stated, terms.models, terms.use_as)
    models = terms.models if lens is None else list(lens.known)
    return ResolvedCamera(camera, source.pairs, in_radians(camera.bounds), lens, models)
