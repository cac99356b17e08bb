"""Calibrations in the formats of other programs."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

import httpx

from apexcal.documents.exports import FormatView
from apexcal.documents.publications import CURRENT
from apexcal.transport import Resource, at

_FILE_NAME = re.compile(r'filename="([^"/\\]+)"')


class ExportedFile(NamedTuple):
    """A file with the name that the service gives it. A format of several files comes as one ``.zip``.

    ``notes`` are sentences that its reader has to know: which lens a mount needs, what a format leaves out of a lens.
    """

    name: str
    content: bytes
    notes: Sequence[str] = ()


class Exports(Resource):
    """``client.exports``: a camera's current calibration, or any result, as files for other programs."""

    def formats(self) -> list[FormatView]:
        """The table of the formats: which way each one's transform leads, and what of a lens it carries."""
        return [FormatView.model_validate(view) for view in self._http.send("GET", "/export-formats").json()]

    def current(self, vehicle_id: UUID | str, camera: str, format: str, alias: str = CURRENT) -> ExportedFile:
        """A camera's current calibration, or what another alias leads to.

        If the format cannot carry it, raises ApiError ``format_cannot_carry``; ``formats`` names those that can.
        """
        return self._file(_current(vehicle_id, camera), format, alias=alias)

    def result(self, result_id: UUID | str, format: str) -> ExportedFile:
        """Any result. Raises ApiError ``format_cannot_carry`` as :meth:`current` does."""
        return self._file(at("results", result_id), format)

    def urdf(self, vehicle_id: UUID | str, camera: str, urdf: str, joint: str, **links: str) -> ExportedFile:
        """The vehicle's own URDF, its ``joint`` set to the camera's current calibration.

        ``links``: ``camera_link`` and ``lidar_link``, if the links are not named like the frames.
        """
        return self._patched(_current(vehicle_id, camera), urdf, joint, links)

    def urdf_of_result(self, result_id: UUID | str, urdf: str, joint: str, **links: str) -> ExportedFile:
        """Like the method above, with any result in place of the current calibration."""
        return self._patched(at("results", result_id), urdf, joint, links)

    def _file(self, path: str, format: str, **query: str) -> ExportedFile:
        answer = self._http.get_export(path, format, **query)
        named = _FILE_NAME.search(answer.headers.get("content-disposition", ""))
        return _exported(named[1] if named else format, answer)

    def _patched(self, path: str, urdf: str, joint: str, links: dict[str, str]) -> ExportedFile:
        body = {"urdf": urdf, "joint": joint, **links}
        return _exported("vehicle.urdf", self._http.send("POST", path + "/urdf", json=body))


def _exported(name: str, answer: httpx.Response) -> ExportedFile:
    return ExportedFile(name, answer.content, json.loads(answer.headers.get("apexcal-notes", "[]")))


def _current(vehicle_id: UUID | str, camera: str) -> str:
    return at("vehicles", vehicle_id, "cameras", camera, "calibration")
