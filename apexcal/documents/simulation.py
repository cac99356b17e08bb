"""Options of the simulation: each option of ``apexcal simulate`` once, with its default, limits and help."""

from __future__ import annotations

import re
from typing import Any, Final, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, field_validator

from apexcal.documents.camera_models import MODELS, ModelName

Format = Literal["bag", "db3", "mcap"]
SensorName = Literal[
    "vlp16", "puck-hi-res", "vlp32c", "hdl32", "hdl64", "alpha-prime", "os0-128", "os1-32", "os1-64", "os1-128",
    "os2-128", "xt32", "qt64", "pandar40p", "mixed128", "lux4",
]  # fmt: skip
WalkName = Literal["rows", "field", "cover", "yard", "slow", "still"]
SecondPerson = Literal["none", "beside", "behind"]
FRONT: Final = "front"
BOARD_EDGES_M: Final = (0.6096, 0.9144)  # 2 x 3 feet
NOMINAL_PITCH_DOWN_DEG: Final = 15.0  # as in the paper
_YAWS_DEG: Final = {FRONT: 0.0, "left": 45.0, "right": -45.0, "front_left": 25.0, "front_right": -25.0}
_MAX_CAMERAS: Final = 11
_MAX_YAW_DEG: Final = 70.0
_OUTERMOST_YAW_DEG: Final = 50.0  # of cameras that are only counted
_CAMERA_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")


class CameraSpec(NamedTuple):
    """A camera of the rig: its name, how far to the left it looks, and its lens (None: as ``camera_model``)."""

    name: str = FRONT
    yaw_deg: float = 0.0
    model: ModelName | None = None


def _option(
    group: str, default: Any, metavar: str | None, text: str, low: float | None = None, high: float | None = None
) -> Any:
    shown = {"group": group, "metavar": metavar}
    return Field(default, ge=low, le=high, description=text, json_schema_extra=shown)


class Disturbances(BaseModel):
    """Disturbances of real recordings that a clean simulation lacks. The defaults change nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    beam_mrad: float = _option("LiDAR", 0.0, "MRAD", "Full width of a beam; edges grow by half of it.", 0.0, 20.0)
    dropouts: float = _option("LiDAR", 0.0, "SHARE", "Returns that are lost.", 0.0, 0.9)
    walker_height_m: float = _option("Walk", 1.74, "M", "A taller person lifts the board higher.", 1.4, 2.1)
    head_above_m: float = _option(
        "What is in the way", 0.0, "M", "The head is at least this far above the board; 0: behind it.", 0.0, 0.3
    )
    second_person: SecondPerson = _option("What is in the way", "none", None, "Where a second person walks.")
    poles: int = _option("What is in the way", 0, "N", "Poles where the walker walks.", 0, 20)
    speckle: float = _option(
        "What is in the way", 0.0, "SHARE", "Beams that meet rain, snow or dust close by.", 0.0, 0.5
    )


class SimulationOptions(Disturbances):
    """A recording to simulate. The same options give the same files.

    Raises ValueError (pydantic's ValidationError) for what cannot be simulated.
    """

    format: Format = _option("Recording", "bag", None, "ROS 1 bag; ROS 2 bag folder (db3, mcap).")
    seconds: float = _option("Recording", 120.0, "S", "Length of the recording.", 1.0, 3600.0)
    seed: int = _option("Recording", 1, "N", "Seed of walk, mounts and noise.", 0)
    sensor: SensorName = _option("LiDAR", "vlp16", None, "LiDAR model: rings, azimuth step, rate.")
    rings: int | None = _option("LiDAR", None, "N", "Another number of rings, evenly over its elevations.", 4, 128)
    sector_deg: float = _option(
        "LiDAR", 60.0, "DEG", "Azimuths that it reports, to either side; 180 is all round.", 5.0, 180.0
    )
    range_noise_mm: float = _option("LiDAR", 8.0, "MM", "Standard deviation of a range.", 0.0, 500.0)
    cameras: str = _option(
        "Cameras",
        FRONT,
        "NAMES",
        "Out of front, left, right, front_left, front_right; NAME:DEGREES (to the left) for any other, "
        "NAME:DEGREES:MODEL for a lens of its own; or how many, up to 11.",
    )
    camera_model: ModelName = _option("Cameras", "brown_conrady", None, "Model of their lens.")
    camera_hz: float = _option("Cameras", 15.0, "HZ", "Frames per second of each.", 1.0, 120.0)
    images: Literal["colour", "thermal"] = _option(
        "Cameras",
        "colour",
        None,
        "colour: JPEG; thermal: 16 bits (mono16) of a thermal camera; the board is warmer or colder than the air.",
    )
    pitch_down_deg: float = _option("Cameras", NOMINAL_PITCH_DOWN_DEG, "DEG", "How far they look down.", -30.0, 40.0)
    camera_info: Literal["none", "raw", "rectified"] = _option(
        "Cameras", "none", None, "Write image_raw or image_rect_color, CameraInfo and a URDF."
    )
    tree: Literal["nominal", "true"] = _option(
        "Cameras", "nominal", None, "Where cameras stand in that URDF: as drawn, or as they are."
    )
    clock_offset_ms: float = _option(
        "Cameras", 0.0, "MS", "How far their clock is ahead of the LiDAR's.", -10_000.0, 10_000.0
    )
    clock_jitter_ms: float = _option("Cameras", 0.0, "MS", "Standard deviation of their stamps.", 0.0, 20.0)
    walk: WalkName = _option(
        "Walk",
        "rows",
        None,
        "rows: across the field, slow where near, what we advise; field: from anywhere to anywhere in 10 x 30 m at "
        "0.7 to 1.6 m/s; cover: row by row over that field to its edges; yard: as field, but ends at 14 m; slow: as "
        "field, at 0.15 to 0.3 m/s; still: on one spot.",
    )
    board: str = _option(
        "Walk", "{}x{}".format(*BOARD_EDGES_M), "WxH", "Lengths of its edges in metres, left and right of the tip."
    )

    @field_validator("cameras")
    @classmethod
    def _cameras_are_known(cls, text: str) -> str:
        parse_cameras(text)
        return text

    @field_validator("board")
    @classmethod
    def _board_is_sized(cls, text: str) -> str:
        if not all(0.3 <= edge <= 1.5 for edge in parse_board(text)):
            raise ValueError("the board's edges must lie between 0.3 and 1.5 m")
        return text

    def camera_specs(self) -> tuple[CameraSpec, ...]:
        """The cameras of the rig; a lens of None is ``camera_model``."""
        return parse_cameras(self.cameras)

    def board_m(self) -> tuple[float, float]:
        """Metres of the board's edges to the left and to the right of the tip, as the LiDAR sees it."""
        return parse_board(self.board)


def parse_board(text: str) -> tuple[float, float]:
    """Return the edges of ``0.61x0.91``, metres. Raises ValueError."""
    match = re.fullmatch(r"(\d*\.?\d+)x(\d*\.?\d+)", text)
    if match is None:
        raise ValueError("a board is given as 0.61x0.91, metres of both edges")
    return float(match[1]), float(match[2])


def parse_cameras(text: str) -> tuple[CameraSpec, ...]:
    """Return the cameras of ``front,left``, ``front,side:60,rear:-20:pinhole`` or a number. Raises ValueError."""
    if re.fullmatch(r"\d+", text):
        return _counted_cameras(int(text))
    cameras = tuple(_parse_camera(part.strip()) for part in text.split(","))
    names = [camera.name for camera in cameras]
    if len(names) > _MAX_CAMERAS or len(set(names)) < len(names):
        raise ValueError(f"a rig has 1 to {_MAX_CAMERAS} cameras of different names")
    return cameras


def _counted_cameras(count: int) -> tuple[CameraSpec, ...]:
    if not 1 <= count <= _MAX_CAMERAS:
        raise ValueError(f"cameras must be 1 to {_MAX_CAMERAS}")
    if count == 1:
        return (CameraSpec(),)
    step_deg = 2.0 * _OUTERMOST_YAW_DEG / (count - 1)
    return tuple(
        CameraSpec(f"camera_{index + 1}", round(_OUTERMOST_YAW_DEG - index * step_deg, 1)) for index in range(count)
    )


def _parse_camera(text: str) -> CameraSpec:
    name, *rest = text.split(":")
    if not _CAMERA_NAME.fullmatch(name) or name == "lidar":
        raise ValueError(f"{name!r} is no name for a camera: lower-case letters, digits and underscores")
    if not rest and name not in _YAWS_DEG:
        names = ", ".join(_YAWS_DEG)
        raise ValueError(f"where does camera {name!r} look? Say {name}:DEGREES (to the left), or one of {names}")
    try:
        yaw_deg = float(rest[0]) if rest and rest[0] else _YAWS_DEG.get(name, 0.0)
    except ValueError:
        raise ValueError(f"{rest[0]!r} in {text!r} is no angle in degrees") from None
    if not abs(yaw_deg) <= _MAX_YAW_DEG:
        raise ValueError(f"camera {name} must look within {_MAX_YAW_DEG:g} degrees of ahead")
    model: ModelName | None = next((model for model in MODELS if rest[1:] == [model]), None)
    if len(rest) > 1 and model is None:
        raise ValueError(f"there is no camera model {':'.join(rest[1:])!r}; one of {', '.join(MODELS)}")
    return CameraSpec(name, yaw_deg, model)
