"""What every writer of recordings takes and gives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from numpy.typing import NDArray

from workers.readers.copying.edits import CameraEdit
from workers.readers.recording import Sweep


@dataclass(frozen=True, slots=True)
class Picture:
    """One camera frame before it is encoded.

    Attributes:
        stamp_ns: what the camera's clock said, UTC nanoseconds.
        image: (height, width, 3) uint8 BGR, or (height, width) uint16 of a thermal camera.
    """

    stamp_ns: int
    image: NDArray[Any]


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """A camera as a writer must know it before the first frame.

    Attributes:
        name: the rig's name for it.
        frame_id: its coordinate frame.
        image_size: width, height in pixels.
        rate_hz: frames per second, about.
        topic: last word of its images' topic in a bag.
        info: what its driver states with each of them; None: nothing.
        is_deep: whether its images have 16 bits, and are not compressed.
    """

    name: str
    frame_id: str
    image_size: tuple[int, int]
    rate_hz: float
    topic: str = "image"
    info: CameraEdit | None = None
    is_deep: bool = False


class RecordingWriter(ABC):
    """A recording that grows; complete when it is closed. Raises FileExistsError where something is at its path.

    Attributes:
        path: the file or folder that one uploads.
        names: what the recording calls ``lidar`` and each camera.
    """

    names: dict[str, str]

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise FileExistsError(f"{path} is there already")
        self.path = path

    @abstractmethod
    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        """``received_ns`` is when the recorder got it, as drivers send after the turn."""

    @abstractmethod
    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        """A frame of the camera of that name."""

    @abstractmethod
    def close(self) -> None:
        """Complete the recording."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
