"""Regions of interest, the vertices that detectors find inside them, and the offset between the clocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from uuid import UUID

from apexcal.documents.analyses import OffsetView, PreviewView, SuggestionView
from apexcal.documents.corners import CornerName
from apexcal.documents.detections import DetectionView, VertexView
from apexcal.documents.detectors import PairingMode
from apexcal.documents.machine_marks import MachineMark, MarksList, MarksView
from apexcal.transport import Resource, at


class DetectionRuns(Resource):
    """``client.detections``: previews and suggestions of a region, detection runs, clock offsets.

    What starts work returns at once; follow it with ``client.wait``.
    """

    def preview(self, recording_id: UUID | str, region: Mapping[str, Any]) -> PreviewView:
        """Ask how many frames and points a region keeps."""
        body = {"kind": "preview", "region": region}
        return self._http.post(at("recordings", recording_id, "analyses"), PreviewView, body)

    def suggest(self, recording_id: UUID | str) -> SuggestionView:
        """Ask for a region around what moves; its ``result`` has ``region`` and ``facts``."""
        return self._http.post(at("recordings", recording_id, "analyses"), SuggestionView, {"kind": "suggestion"})

    def estimate_offset(
        self, recording_id: UUID | str, detection_id: UUID | str, camera: str, *, model: str | None = None
    ) -> OffsetView:
        """Estimate how far the camera's clock is ahead of the LiDAR's, from a detection's vertices and their marks.

        Its ``result`` has ``offset_ns`` and ``sigma_ns``, for ``create(..., offset_ns=...)``; ``model`` is the lens
        that is fitted along.
        """
        body = {"kind": "clock_offset", "detection_id": str(detection_id), "camera": camera}
        body |= {"model": model} if model else {}
        return self._http.post(at("recordings", recording_id, "analyses"), OffsetView, body)

    def offsets(self, recording_id: UUID | str) -> Iterator[OffsetView]:
        """The clock offsets that were estimated of a recording, newest first."""
        return self._http.items(at("recordings", recording_id, "analyses"), OffsetView, kind="clock_offset")

    def ask_marks(self, recording_id: UUID | str, detection_id: UUID | str, camera: str) -> MarksView:
        """Have the machine mark a detection's vertices in one camera."""
        body = {"kind": "machine_marks", "detection_id": str(detection_id), "camera": camera}
        return self._http.post(at("recordings", recording_id, "analyses"), MarksView, body)

    def machine_marks(self, recording_id: UUID | str) -> Iterator[MarksView]:
        """What the machine was asked to mark in a recording, newest first."""
        return self._http.items(at("recordings", recording_id, "analyses"), MarksView, kind="machine_marks")

    def marks(self, analysis_id: UUID | str) -> list[MachineMark]:
        """The machine's marks and reasons. What one answers on their vertices afterwards counts as reviewed."""
        return self._http.get(at("analyses", analysis_id, "marks"), MarksList).marks

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
