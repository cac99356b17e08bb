"""Calibrations tested on other pairs and drives, and how a camera's results drift."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from uuid import UUID

from apexcal.documents.validations import Drift, ValidationKind, ValidationView
from apexcal.transport import Resource, at


class Validations(Resource):
    """``client.validations``. What starts work returns at once; follow it with ``client.wait``."""

    def ask(
        self,
        vehicle_id: UUID | str,
        kind: ValidationKind,
        camera: str,
        *,
        set_id: UUID | str | None = None,
        recording_id: UUID | str | None = None,
        result_id: UUID | str | None = None,
        calibration: Mapping[str, Any] | None = None,
    ) -> ValidationView:
        """Test a calibration on other data: ``pairs`` of a set, ``lanes`` or ``edges`` of a recording.

        The calibration is a result's, or ``{"lens": ..., "transform": T_camera_lidar}``, or else the current one.
        """
        body: dict[str, Any] = {
            "kind": kind,
            "camera": camera,
            "set_id": set_id and str(set_id),
            "recording_id": recording_id and str(recording_id),
            "result_id": result_id and str(result_id),
            "calibration": calibration and dict(calibration),
        }
        return self._http.post(at("vehicles", vehicle_id, "validations"), ValidationView, body)

    def get(self, validation_id: UUID | str) -> ValidationView:
        """A validation and, when it is done, its ``result``."""
        return self._http.get(at("validations", validation_id), ValidationView)

    def list(self, vehicle_id: UUID | str) -> Iterator[ValidationView]:
        """The validations of a vehicle, newest first, without single pairs."""
        return self._http.items(at("vehicles", vehicle_id, "validations"), ValidationView)

    def drift(self, vehicle_id: UUID | str, camera: str, *, limit: int = 20, after: str | None = None) -> Drift:
        """A camera's newest recommended results, oldest first, each compared with the one before and the first.

        ``after``: the ``next`` of an answer, to get the results before these.
        """
        asked = {"limit": limit} if after is None else {"limit": limit, "after": after}
        return self._http.get(at("vehicles", vehicle_id, "drift"), Drift, camera=camera, **asked)
