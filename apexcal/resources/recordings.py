"""Recordings: upload, state, frames, and the original back."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from uuid import UUID

from apexcal.documents.recordings import (
    AcceptedRecording,
    BlobAddress,
    CreatedRecording,
    FrameView,
    Original,
    RecordingSummary,
    RecordingView,
)
from apexcal.documents.rig_proposals import RigProposal
from apexcal.documents.sweeps import MEDIA_TYPE, SweepView
from apexcal.errors import ClientError
from apexcal.presigned import EndedAddressError, PresignedStore
from apexcal.transport import Resource, at, if_match
from apexcal.upload_sources import open_source
from apexcal.uploads import OnSent, send_parts


class Recordings(Resource):
    """``client.recordings``."""

    # Whether the service has said that it serves byte ranges itself.
    _ranges_here = False

    def create(
        self,
        vehicle_id: UUID | str,
        rig_id: UUID | str | None,
        name: str,
        file_name: str,
        *,
        size: int | None = None,
        marks_per_vertex: int = 1,
        retain_days: int | None = None,
        reading: Mapping[str, Any] | None = None,
    ) -> CreatedRecording:
        """Announce a recording of ``size`` bytes; its parts follow. ``upload.part_bytes`` says how large.

        Without a rig the vehicle gets one that reading the recording describes.

        ``reading`` is what the file does not say of itself: ``topics`` (``{"lidar": TOPIC, "cameras": {NAME:
        TOPIC}}``), ``point_times`` (``auto`` or ``stamp_only``), ``stamp_convention`` (``start`` or ``end``),
        ``rate_hz``, ``lidar_model``, ``rings``, ``camera_start_ns``.
        """
        body: dict[str, Any] = {
            "rig_id": None if rig_id is None else str(rig_id),
            "name": name,
            "file_name": file_name,
            "size": size,
            "marks_per_vertex": marks_per_vertex,
            "retain_days": retain_days,
            "reading": dict(reading or {}),
        }
        return self._http.post(at("vehicles", vehicle_id, "recordings"), CreatedRecording, body)

    def upload(
        self,
        path: Path,
        vehicle_id: UUID | str,
        rig_id: UUID | str | None = None,
        *,
        name: str | None = None,
        resume: bool = False,
        on_progress: OnSent | None = None,
        **announced: Any,
    ) -> RecordingView:
        """Upload a file, or a folder as a tar, and return its recording while it is being ingested.

        An upload that breaks off leaves the recording ``uploading``. ``resume`` goes on with the newest one of this
        vehicle, rig and file name, if there is one. Without a rig it gets one that reading it describes.
        ``announced``: what :meth:`create` takes besides.
        """
        source = open_source(path)
        recording = self._unfinished(source.name, vehicle_id, rig_id) if resume else None
        if recording is None:
            size = source.size or None
            name = name or path.resolve().name
            recording = self.create(vehicle_id, rig_id, name, source.name, size=size, **announced)
        return self.resume(recording, path, on_progress=on_progress)

    def resume(self, recording: RecordingSummary, path: Path, *, on_progress: OnSent | None = None) -> RecordingView:
        """Send what is missing of a recording's upload, and complete it."""
        sent = send_parts(self._http, recording, open_source(path), on_progress)
        body = {"parts": sent.parts, "size": sent.size, "sha256": sent.sha256}
        return self._http.post(at("recordings", recording.id, "complete"), AcceptedRecording, body).recording

    def _unfinished(
        self, file_name: str, vehicle_id: UUID | str, rig_id: UUID | str | None
    ) -> RecordingSummary | None:
        """The newest recording of this vehicle whose upload of a file of this name broke off."""
        broken_off = [
            recording
            for recording in self.list(vehicle_id=vehicle_id, state="uploading")
            if recording.file_name == file_name and rig_id in (None, recording.rig_id, str(recording.rig_id))
        ]
        return max(broken_off, key=lambda recording: recording.created_at, default=None)

    def list(
        self, *, fleet_id: UUID | str | None = None, vehicle_id: UUID | str | None = None, state: str | None = None
    ) -> Iterator[RecordingSummary]:
        """Recordings of a fleet or a vehicle."""
        return self._http.items(
            "/recordings", RecordingSummary, fleet_id=fleet_id, vehicle_id=vehicle_id, state=state
        )

    def get(self, recording_id: UUID | str) -> RecordingView:
        """One recording with its state, facts, warnings, problem and sensors."""
        return self._http.get(at("recordings", recording_id), RecordingView)

    def edit(self, recording: RecordingSummary, **changes: Any) -> RecordingView:
        """Change ``name`` or ``marks_per_vertex``; ``rig_id``; before a recording is ready ``reading`` too."""
        return self._http.patch(at("recordings", recording.id), RecordingView, changes, version=recording.version)

    def state_lens(self, recording: RecordingSummary, camera: str, lens: Mapping[str, Any]) -> RecordingView:
        """State a camera's lens: ``width``, ``height``, ``distortion_model``, ``K``, ``D``, ``source``."""
        path = at("recordings", recording.id, "cameras", camera, "lens")
        return self._http.put(path, RecordingView, lens, if_match(recording.version))

    def retry(self, recording_id: UUID | str) -> RecordingView:
        """Ingest a failed recording again."""
        return self._http.post(at("recordings", recording_id, "retry"), AcceptedRecording).recording

    def propose_rig(self, recording_id: UUID | str, **request: Any) -> RigProposal:
        """Propose a recording's rig. ``request``: ``urdf`` (text), ``frames``, ``looks``, ``joints``, ``name``."""
        return self._http.post(at("recordings", recording_id, "rig-proposals"), RigProposal, request)

    def delete(self, recording_id: UUID | str, *, with_published: bool = False) -> None:
        """Delete a recording with everything that came from it."""
        self._http.delete(at("recordings", recording_id), with_published=True if with_published else None)

    def frames(self, recording_id: UUID | str, camera: str) -> Iterator[FrameView]:
        """Every frame of a camera: ``index``, ``stamp_ns``, ``media_type``, ``width``, ``height``."""
        return self._http.items(at("recordings", recording_id, "cameras", camera, "frames"), FrameView, limit=5000)

    def frame(self, recording_id: UUID | str, camera: str, index: int) -> bytes:
        """One frame's image file (JPEG, PNG or WebP), straight from the store where the service says so."""
        path = at("recordings", recording_id, "cameras", camera, "frames", index)
        return self._range(path, "image/*")

    def sweeps(self, recording_id: UUID | str) -> Iterator[SweepView]:
        """Every sweep of the LiDAR: ``index``, ``stamp_ns``, ``points``, ``length``."""
        return self._http.items(at("recordings", recording_id, "sweeps"), SweepView, limit=5000)

    def sweep(self, recording_id: UUID | str, index: int) -> bytes:
        """One sweep's points, packed; :func:`apexcal.sweeps.unpack` makes arrays of them."""
        return self._range(at("recordings", recording_id, "sweeps", index), MEDIA_TYPE)

    def _range(self, path: str, media_type: str) -> bytes:
        """A byte range of a sensor's file, straight from the store where the service says so."""
        if not self._ranges_here:
            address = self._http.get(f"{path}/address", BlobAddress)
            if address.url:
                with PresignedStore(self._http) as store:
                    return store.get(address.url, address.offset, address.length)
            self._ranges_here = True
        return self._http.send("GET", path, headers={"Accept": media_type}).content

    def download(self, recording_id: UUID | str, target: Path) -> int:
        """Write the original to a new file and return its size in bytes."""
        return write_new(target, self._original(at("recordings", recording_id, "original")))

    def _original(self, path: str) -> Iterator[bytes]:
        parts = self._http.get(f"{path}/parts", Original).parts
        if parts[0].url is None:
            with self._http.stream(path) as response:
                yield from response.iter_bytes(1 << 20)
            return
        with PresignedStore(self._http) as store:
            for position, part in enumerate(list(parts)):
                try:
                    data = store.get(part.url or "", 0, part.size)
                except EndedAddressError:
                    # A large file takes longer than addresses live.
                    parts = self._http.get(f"{path}/parts", Original).parts
                    data = store.get(parts[position].url or "", 0, part.size)
                if hashlib.sha256(data).hexdigest() != part.sha256:
                    raise ClientError(
                        f"part {part.number} of the original is not what was uploaded",
                        "Try again; if it happens again, the operator should look at the store.",
                    )
                yield data


def write_new(target: Path, chunks: Iterable[bytes], sha256: str | None = None) -> int:
    """Write a file that does not exist yet, and return its size in bytes. Its digest is compared with a given one."""
    if target.exists():
        raise ClientError(f"{target} exists already", "Name a file that does not exist yet.")
    part, digest = target.with_name(target.name + ".part"), hashlib.sha256()
    with part.open("wb") as file:
        for chunk in chunks:
            digest.update(chunk)
            file.write(chunk)
    if sha256 is not None and digest.hexdigest() != sha256:
        part.unlink()
        raise ClientError(f"what was sent of {target.name} is not what the service made", "Try again.")
    part.replace(target)
    return target.stat().st_size
