"""Regions of interest, and the vertices that detectors find inside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from uuid import UUID

from apexcal.transport import Document, Transport, at


class Detections:
    """``client.detections``: previews of a region, and detection runs."""

    def __init__(self, transport: Transport) -> None:
        self._http = transport

    def preview(self, recording_id: UUID | str, region: Mapping[str, Any]) -> Document:
        """Ask how many frames and points a region keeps; follow it with ``client.wait``."""
        return self._http.post(at("recordings", recording_id, "region-previews"), {"region": region})

    def get_preview(self, preview_id: UUID | str) -> Document:
        """A preview and, when it is done, its ``result``."""
        return self._http.get(at("region-previews", preview_id))

    def create(
        self,
        recording_id: UUID | str,
        region: Mapping[str, Any],
        *,
        detector: str = "tolerant",
        options: Mapping[str, Any] | None = None,
        offset_ns: int = 0,
        max_gap_ns: int = 50_000_000,
    ) -> Document:
        """Start a detection run. ``offset_ns`` is added to a vertex's time before its camera frame is looked for."""
        body = {
            "region": region,
            "detector": detector,
            "options": dict(options or {}),
            "pairing": {"offset_ns": offset_ns, "max_gap_ns": max_gap_ns},
        }
        return self._http.post(at("recordings", recording_id, "detections"), body)

    def list(self, recording_id: UUID | str) -> Iterator[Document]:
        """The detection runs of a recording."""
        return self._http.items(at("recordings", recording_id, "detections"))

    def get(self, detection_id: UUID | str) -> Document:
        """One detection run with its ``state`` and ``counts``."""
        return self._http.get(at("detections", detection_id))

    def cancel(self, detection_id: UUID | str) -> Document:
        """End a run that is not done."""
        return self._http.post(at("detections", detection_id, "cancel"))

    def vertices(self, detection_id: UUID | str, *, camera: str | None = None) -> Iterator[Document]:
        """Every vertex (metres, LiDAR frame; ``time_ns`` is when it was measured) with its camera frames."""
        return self._http.items(at("detections", detection_id, "vertices"), camera=camera)
