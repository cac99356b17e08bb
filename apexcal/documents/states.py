"""The states of rows. Columns hold them as plain text, so that older and newer processes share a database."""

from __future__ import annotations

from enum import StrEnum


class WorkState(StrEnum):
    """State of a job, an analysis, a detection, a calibration or a run."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


UNENDED = (WorkState.QUEUED, WorkState.RUNNING)


class RecordingState(StrEnum):
    """State of a recording: its upload, its ingestion and the outcome."""

    UPLOADING = "uploading"
    QUEUED = "queued"
    INGESTING = "ingesting"
    READY = "ready"
    FAILED = "failed"


class RequestState(StrEnum):
    """States of a fleet request."""

    RUNNING = "running"
    DONE = "done"
    DONE_WITH_FAILURES = "done_with_failures"
    CANCELLED = "cancelled"


class VehicleState(StrEnum):
    """State of a vehicle in a fleet request. ``running`` is never stored: it follows from the states of its jobs."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"
    SKIPPED = "skipped"


class CameraState(StrEnum):
    """The kinds of answers that a vehicle gets for a camera, the gravest first."""

    WITHDRAWN = "withdrawn"
    NONE = "none"
    PUBLISHED = "published"


class CameraWork(StrEnum):
    """The work that a camera waits for, a person's decision first. ``marks``: a recording has no calibration yet."""

    DECISION = "decision"
    RUNNING = "running"
    MARKS = "marks"
    RECORDING = "recording"
    NOTHING = "nothing"
