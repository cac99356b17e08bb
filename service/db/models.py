"""All tables in one place, for the code that asks and for migrations."""

from service.db.annotations import (
    AnnotationRevision,
    Answer,
    Disclosure,
    Mark,
    MarkingFrontier,
    MarkingProgress,
    MarkingTask,
    Verdict,
)
from service.db.base import Base
from service.db.calibrations import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Result,
    Slot,
)
from service.db.detections import Apex, Detection, Vertex, VertexFrame
from service.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.db.fleets import Fleet, Rig, RigCamera, Vehicle
from service.db.jobs import Heartbeat, Job, JobEvent, JobTotal, Worker
from service.db.people import ApiToken, BrowserSession, IdempotencyKey, Membership, Person, SignInLink
from service.db.publications import Publication
from service.db.recordings import (
    Blob,
    BlobHold,
    CameraFrame,
    PackedSweep,
    PackedSweeps,
    Recording,
    Sensor,
    UploadPart,
)
from service.db.reports import Report
from service.db.studies import Study, StudyFile
from service.db.validations import Validation

__all__ = [
    "AnnotationRevision",
    "Answer",
    "Apex",
    "ApiToken",
    "Base",
    "Blob",
    "BlobHold",
    "BrowserSession",
    "Calibration",
    "CalibrationRun",
    "CameraFrame",
    "CorrespondenceSet",
    "Detection",
    "Disclosure",
    "Fleet",
    "FleetRequest",
    "FleetRequestVehicle",
    "Heartbeat",
    "IdempotencyKey",
    "Job",
    "JobEvent",
    "JobTotal",
    "Mark",
    "MarkingFrontier",
    "MarkingProgress",
    "MarkingTask",
    "Membership",
    "PackedSweep",
    "PackedSweeps",
    "Person",
    "Publication",
    "Recording",
    "Report",
    "Result",
    "Rig",
    "RigCamera",
    "Sensor",
    "SignInLink",
    "Slot",
    "Study",
    "StudyFile",
    "UploadPart",
    "Validation",
    "Vehicle",
    "Verdict",
    "Vertex",
    "VertexFrame",
    "Worker",
]
