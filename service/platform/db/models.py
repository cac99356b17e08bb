"""All tables in one place, for the code that asks and for migrations."""
# ruff: noqa: F401
# pyright: reportUnusedImport=false

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.annotations import (
    Answer,
    CropPage,
    Disclosure,
    MarkingFrontier,
    MarkingProgress,
    MarkingTask,
)
from service.platform.db.base import Base
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result, Slot
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.jobs import Heartbeat, Job, JobEvent, JobTotal, Worker
from service.platform.db.people import (
    ApiToken,
    AuditEntry,
    BrowserSession,
    IdempotencyKey,
    Membership,
    Person,
    SignInLink,
)
from service.platform.db.recordings import (
    Blob,
    BlobHold,
    CameraFrame,
    Recording,
    Sensor,
    UploadPart,
)
