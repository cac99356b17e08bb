"""The vertices that detectors find inside a region of interest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from uuid import UUID

from apexcal.documents.corners import CornerName
from apexcal.documents.detections import DetectionView, VertexView
from apexcal.documents.detectors import PairingMode
from apexcal.transport import Resource, at


class DetectionRuns(Resource):
    """``client.detections``. What starts work returns at once; follow it with ``client.wait``."""

    def ask_corners(self, detection_id: UUID | str, corners: Sequence[CornerName]) -> DetectionView:
        """Have these corners of the board marked, of a finished detection that knows the board's size."""
        body = {"marked_corners": list(corners)}
        return self._http.patch(at("detections", detection_id), DetectionView, body)

    def create(
        self,
        recording_id: UUID | str,
        region: Mapping[str, Any],
        *,
        detector: str = "refined",
        options: Mapping[str, Any] | None = None,
        offset_ns: int = 0,
        max_gap_ns: int = 50_000_000,
        mode: PairingMode = "auto",
    ) -> DetectionView:
        """Start a detection run. ``offset_ns`` is added to a vertex's time before its camera frame is looked for.

        ``mode="interpolate"`` moves each vertex along its track to the time of its frame, ``"auto"`` where there is a
        track, ``"nearest"`` none.
        """
        body = {
            "region": region,
            "detector": detector,
            "options": dict(options or {}),
            "pairing": {"mode": mode, "offset_ns": offset_ns, "max_gap_ns": max_gap_ns},
        }
        return self._http.post(at("recordings", recording_id, "detections"), DetectionView, body)

    def list(self, recording_id: UUID | str) -> Iterator[DetectionView]:
        """The detection runs of a recording."""
        return self._http.items(at("recordings", recording_id, "detections"), DetectionView)

    def get(self, detection_id: UUID | str) -> DetectionView:
        """One detection run with its ``state`` and ``counts``."""
        return self._http.get(at("detections", detection_id), DetectionView)

    def delete(self, detection_id: UUID | str) -> None:
        """Delete a detection with its pairs and calibrations, unless one is published. Marks stay."""
        self._http.delete(at("detections", detection_id))

    def cancel(self, detection_id: UUID | str) -> DetectionView:
        """End a run that is not done."""
        return self._http.post(at("detections", detection_id, "cancel"), DetectionView)

    def vertices(
        self, detection_id: UUID | str, *, camera: str | None = None, quality: str | None = None
    ) -> Iterator[VertexView]:
        """Every vertex (metres, LiDAR frame; ``time_ns`` is when it was measured) with its camera frames.

        ``quality="fine"`` gives only those; ``covariance`` is over azimuth (rad), elevation (rad) and range (m).
        """
        return self._http.items(
            at("detections", detection_id, "vertices", "details"), VertexView, camera=camera, quality=quality
        )
