"""What can be simulated, checked before anything is written."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from workers.geometry.models import MODELS, ModelName
from workers.simulation.camera import FRONT, NOMINAL_PITCH_DOWN_DEG
from workers.simulation.disturbances import Disturbances
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import BOARD_EDGES_M
from workers.simulation.walks import WALKS

Format = Literal["bag", "db3", "mcap", "pcap", "pcapng", "video", "folder", "tar", "zip", "kitti"]
FORMATS: dict[Format, str] = {
    "bag": "ROS 1 bag",
    "db3": "ROS 2 bag folder, SQLite",
    "mcap": "ROS 2 bag folder, MCAP",
    "pcap": "folder of network packets and JPEG images (vlp16)",
    "pcapng": "the same with a pcapng file (vlp16)",
    "video": "folder of network packets and an MP4 per camera (vlp16)",
    "folder": "folder of PCD files and JPEG images",
    "tar": "that folder as one tar",
    "zip": "that folder as one zip",
    "kitti": "KITTI raw folders: .bin clouds (which have no rings) and PNG images",
}
CameraInfos = Literal["none", "raw", "rectified"]
Tree = Literal["nominal", "true"]
PACKET_FORMATS: tuple[Format, ...] = ("pcap", "pcapng", "video")
_YAWS_DEG = {FRONT: 0.0, "left": 45.0, "right": -45.0, "front_left": 25.0, "front_right": -25.0}
_MOST_CAMERAS = 11
_WIDEST_DEG = 70.0
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """One camera of the rig.

    Attributes:
        name: lower-case letters, digits and underscores.
        yaw_deg: how far to the left it looks, +-70.
        model: its lens; None: that of the settings.
    """

    name: str = FRONT
    yaw_deg: float = 0.0
    model: ModelName | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or self.name == "lidar":
            raise ValueError(f"{self.name!r} is no name for a camera: lower-case letters, digits and underscores")
        if not abs(self.yaw_deg) <= _WIDEST_DEG:
            raise ValueError(f"camera {self.name} must look within {_WIDEST_DEG:g} degrees of ahead")
        if self.model not in (None, *MODELS):
            raise ValueError(f"there is no camera model {self.model!r}; one of {', '.join(MODELS)}")


def parse_cameras(text: str) -> tuple[CameraSpec, ...]:
    """``front,left``, ``front,side:60,rear_lens:-20:pinhole`` (name, degrees to the left, lens), or how many.

    Raises:
        ValueError: it cannot be understood.
    """
    if re.fullmatch(r"\d+", text):
        count = int(text)
        if not 1 <= count <= _MOST_CAMERAS:
            raise ValueError(f"cameras must be 1 to {_MOST_CAMERAS}, not {count}")
        if count == 1:
            return (CameraSpec(),)
        yaws = np.round(np.linspace(50.0, -50.0, count), 1).tolist()
        return tuple(CameraSpec(f"camera_{number}", yaw) for number, yaw in enumerate(yaws, start=1))
    return tuple(_parse_camera(part.strip()) for part in text.split(","))


def _parse_camera(text: str) -> CameraSpec:
    name, *rest = text.split(":")
    if not rest and name not in _YAWS_DEG:
        known = ", ".join(_YAWS_DEG)
        raise ValueError(f"where does camera {name!r} look? Say {name}:DEGREES (to the left), or one of {known}")
    try:
        yaw_deg = float(rest[0]) if rest and rest[0] else _YAWS_DEG.get(name, 0.0)
    except ValueError:
        raise ValueError(f"{rest[0]!r} in {text!r} is no angle in degrees") from None
    model: ModelName | None = next((known for known in MODELS if rest[1:] == [known]), None)
    if len(rest) > 1 and model is None:
        raise ValueError(f"there is no camera model {':'.join(rest[1:])!r}; one of {', '.join(MODELS)}")
    return CameraSpec(name, yaw_deg, model)


@dataclass(frozen=True, slots=True)
class Settings:
    """What to simulate.

    Attributes:
        seconds: length of the recording.
        seed: of the walk, the mounts, the noise; the same settings give the same files.
        camera_model: the lens of every camera that does not say another.
        cameras: their names and where they look.
        camera_hz: frames per second of each camera; they run free of the LiDAR and of each other.
        pitch_down_deg: of every camera's nominal mount.
        clock_offset_ms: the cameras' clock minus the LiDAR's.
        clock_jitter_ms: standard deviation of a frame's stamp about the moment at which it was taken.
        sensor: name in ``sensors.SENSORS``.
        rings: another number of rings over the sensor's elevations, or None.
        sector_deg: the LiDAR reports azimuths of +- this much, as a VLP-16 can be set to; 180: all round.
        range_noise_mm: standard deviation of each range.
        walk: name in ``walks.WALKS``.
        board_m: lengths of the board's edges, to the left and to the right of the apex as the LiDAR sees it.
        disturbances: what makes the board harder to see.
        format: of the recording, in ``FORMATS``.
        camera_info: ``raw``: a bag holds ``image_raw`` and CameraInfo; ``rectified``: ``image_rect_color`` and the
            same CameraInfo. Both have ``/tf_static``, and ``vehicle.urdf`` beside them.
        tree: whether the cameras stand there as the rig's drawing says or as they are mounted.

    Raises:
        ValueError: a value that cannot be simulated, said in one sentence.
    """

    seconds: float = 120.0
    seed: int = 1
    camera_model: ModelName = "brown_conrady"
    cameras: tuple[CameraSpec, ...] = (CameraSpec(),)
    camera_hz: float = 15.0
    pitch_down_deg: float = NOMINAL_PITCH_DOWN_DEG
    clock_offset_ms: float = 0.0
    clock_jitter_ms: float = 0.0
    sensor: str = "vlp16"
    rings: int | None = None
    sector_deg: float = 60.0
    range_noise_mm: float = 8.0
    walk: str = "rows"
    board_m: tuple[float, float] = BOARD_EDGES_M
    disturbances: Disturbances = field(default_factory=Disturbances)
    format: Format = "bag"
    camera_info: CameraInfos = "none"
    tree: Tree = "nominal"

    def __post_init__(self) -> None:
        for name, low, high in (
            ("seconds", 1.0, 3600.0),
            ("seed", 0, math.inf),
            ("camera_hz", 1.0, 120.0),
            ("pitch_down_deg", -30.0, 40.0),
            ("clock_offset_ms", -10_000.0, 10_000.0),
            ("clock_jitter_ms", 0.0, 20.0),
            ("rings", 4, 128),
            ("sector_deg", 5.0, 180.0),
            ("range_noise_mm", 0.0, 500.0),
        ):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                limits = f"lie between {low:g} and {high:g}" if high < math.inf else "not be negative"
                raise ValueError(f"{name} must {limits}, not {value:g}")
        for what, value, known in (
            ("camera model", self.camera_model, MODELS),
            ("sensor", self.sensor, SENSORS),
            ("walk", self.walk, WALKS),
            ("format", self.format, get_args(Format)),
            ("camera info", self.camera_info, get_args(CameraInfos)),
            ("tree", self.tree, get_args(Tree)),
        ):
            if value not in known:
                raise ValueError(f"there is no {what} {value!r}; one of {', '.join(known)}")
        if not all(0.3 <= edge <= 1.5 for edge in self.board_m):
            raise ValueError(f"the board's edges must lie between 0.3 and 1.5 m, not at {self.board_m}")
        self._check_together()

    def _check_together(self) -> None:
        names = [camera.name for camera in self.cameras]
        if not 1 <= len(names) <= _MOST_CAMERAS or len(set(names)) < len(names):
            raise ValueError(f"a rig has 1 to {_MOST_CAMERAS} cameras of different names, not {_listed(names)}")
        if self.camera_info != "none" and self.format not in ("bag", "db3", "mcap"):
            raise ValueError(f"only bag, db3 and mcap hold a CameraInfo; {self.format} does not")
        if self.format in PACKET_FORMATS and (self.sensor != "vlp16" or self.rings is not None):
            raise ValueError(
                f"only the packets of a vlp16 with its 16 rings are written as {self.format}; choose another format"
            )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
