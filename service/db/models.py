"""All tables in one place, for the code that asks and for migrations."""
# ruff: noqa: F401
# pyright: reportUnusedImport=false

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
