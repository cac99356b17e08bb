"""Requests and answers about detections and vertices."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any
from uuid import UUID

from pydantic import Field, model_validator

from apexcal.documents.base import Document, Received, Sent, Stored
from apexcal.documents.corners import TOP, CornerName
from apexcal.documents.detectors import FLAGS, PairingMode, Quality
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.regions import KeptRegion, Region
from apexcal.documents.states import WorkState

Covariance = list[list[float]]

_ANY_CLOCK_NS = 2**62  # a camera whose clock starts at 0 is off by all of Unix time: 1.8e18 ns
_MINUTE_NS = 60 * 10**9


class Pairing(Received):
    """The pairing of vertices with camera frames: each with the frame nearest to its time plus ``offset_ns``.

    A frame farther away than ``max_gap_ns`` is no pair. ``mode: interpolate`` moves the vertex along its track to the
    frame's own time. The gap is then zero, and the covariance includes the interpolation's error. ``auto`` does so
    with vertices that state a covariance, where those near in time make a track; ``nearest`` leaves vertices where
    they were measured.
    """

    mode: PairingMode = "auto"
    offset_ns: Annotated[int, Field(ge=-_ANY_CLOCK_NS, le=_ANY_CLOCK_NS, description="camera minus LiDAR clock")] = 0
    max_gap_ns: Annotated[int, Field(ge=0, le=_MINUTE_NS, description="farther frames are no pair")] = 50_000_000


class DetectionRequest(Received):
    """Ask for the vertices that a detector finds inside a region."""

    region: Region
    detector: Annotated[str, Field(max_length=50)] = "refined"
    options: Annotated[
        dict[str, Any], Field(default_factory=dict, description="numbers that differ from the defaults")
    ]
    pairing: Pairing = Pairing()


class DetectionEdit(Received):
    """Ask for marks of these corners of the board; ``top`` alone is the default."""

    marked_corners: Annotated[list[CornerName], Field(min_length=1, max_length=4)]


class RollFacts(Document):
    """The hold of the board: turned by ``mean_deg`` on average, with ``spread_deg`` from vertex to vertex.

    Degrees, counter-clockwise as the LiDAR sees it. At 0 both upper edges have the same slope.
    """

    vertices: int
    mean_deg: float
    spread_deg: float


class SizeSeen(Document):
    """The board's size as the near sweeps show it.

    ``seen_m``: its edges, the shorter one first; ``sigma_m``: their standard deviations. ``contradicts``: boards
    whose edges bloom as usual are not of the stated size. ``replaces``: no blooming explains the stated size, so the
    detection used ``seen_m``; otherwise it used the stated size.
    """

    seen_m: tuple[float, float]
    sigma_m: tuple[float, float]
    contradicts: bool = False
    replaces: bool = False


class DetectionCounts(Document):
    """Counts of sweeps read and vertices accepted; of rejected sweeps by reason, of vertices by quality and by flag.

    ``paired`` vertices have a frame of at least one camera. ``frame_taken`` counts vertices without a frame because
    another vertex is nearer to it in time. ``refused_sweeps`` holds, by reason, the first and the last number of each
    run of sweeps that were rejected for it. ``poses``: how many still poses the recording has, each of which gives
    a vertex for every place at which the board stands in it; 0 for a walk. ``poses_stated``: its owner said so;
    otherwise it was noticed. ``poses_walked``: its owner said so, but somebody walks in it. ``size`` is null where
    the near sweeps do not tell it. ``examples``: what one sweep of a reason shows. ``roll`` is null if
    the detector does not tell it.
    """

    sweeps: int = 0
    accepted: int = 0
    rejected: dict[str, int] = {}
    quality: dict[str, int] = {}
    flags: dict[str, int] = {}
    paired: int | None = None
    frame_taken: int | None = None
    refused_sweeps: dict[str, list[tuple[int, int]]] = {}
    examples: dict[str, str] = {}
    poses: int = 0
    poses_stated: bool = False
    poses_walked: bool = False
    size: SizeSeen | None = None
    roll: RollFacts | None = None


class DetectionView(Sent):
    """A detection. ``counts`` grows while it runs. When it is done, ``counts`` also has the paired vertices.

    ``reasons``: a sentence for each reason for which sweeps were rejected, with what to change.
    ``marked_corners`` are the board's corners that people are to mark.
    """

    id: UUID
    fleet_id: UUID
    recording_id: UUID
    region: KeptRegion
    detector: str
    options: Stored[dict[str, int | float]]
    pairing: Stored[Pairing]
    state: WorkState
    counts: Stored[DetectionCounts]
    problem: Stored[ProblemView | None]
    job: JobView | None
    created_at: datetime
    finished_at: datetime | None
    marked_corners: list[CornerName] = [TOP]
    reasons: dict[str, str] = {}


class CornerView(Sent):
    """Another corner of the board than the tip: metres in the LiDAR frame, covariance as in ``VertexView``."""

    corner: CornerName
    x: float
    y: float
    z: float
    covariance: Covariance


class Moved(Sent):
    """A vertex at another moment: metres in the LiDAR frame, covariance as in ``VertexView``."""

    x: float
    y: float
    z: float
    covariance: Covariance


class FrameOfVertex(Sent):
    """The camera frame that a vertex is paired with. ``gap_ns`` is frame time minus vertex time.

    If the pairing interpolates, ``moved`` is where the vertex was at the frame's time, and ``corners`` where the
    board's other corners were.
    """

    index: int
    gap_ns: int
    moved: Moved | None = None
    corners: list[CornerView] = []


class Flag(Sent):
    """A flag: what the person who confirms a vertex should look at. The database holds the name alone."""

    name: str
    sentence: str

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return {"name": value, "sentence": FLAGS.get(value, value)} if isinstance(value, str) else value


class VertexSummary(Sent):
    """A vertex in metres in the LiDAR frame, and what its detector says that one should look at.

    ``quality`` is null if the detector states none. ``corner``: which of the board's corners it is.
    """

    id: UUID
    sweep_index: int
    time_ns: int
    x: float
    y: float
    z: float
    ring: int
    points: int
    quality: Quality | None
    flags: list[Flag]
    corner: CornerName = TOP


class VertexView(VertexSummary):
    """A vertex with its covariance and its frame in each camera that has one.

    ``covariance`` is 3 x 3 over azimuth (rad), elevation (rad) and range (m), null if the detector states none.
    ``corners`` are the board's other corners at the same moment, if the detector knows the board's size. They err
    together: ``joint_covariance``, if it was asked for, is the covariance of the vertex and of all of them, three
    rows each in this order.
    """

    covariance: Covariance | None
    frames: dict[str, FrameOfVertex]
    corners: list[CornerView] = []
    joint_covariance: Covariance | None = None
