"""The recordings as a stranger has them: a folder of clouds and images, or a bag; with a lens beside, or without."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np
import yaml

from apexcal.documents.camera_models import CAMERA_MODELS
from apexcal.documents.readings import ReadOptions
from benchmarks.detection.real import DATA, DIAMOND, RECORDINGS
from benchmarks.marks.real import LENSES
from workers.geometry.models import INTRINSICS
from workers.marks.sights import Lens
from workers.readers.copying.edits import CameraEdit
from workers.readers.detect import open_recording
from workers.readers.recording import Frame, Sweep
from workers.simulation.bag_writer import BagWriter, CameraChannel, Picture

Form = Literal["folder", "bag"]
# The images of Pandar40 were undistorted by their publisher.
LENS_OF: Final = LENSES | {
    "pandar40-tripod": Lens("pinhole", np.array([2525.9, 2528.1, 942.9102, 584.8342])),
}
LOOKS: Final = {DIAMOND: "forward", "os1-64-board": "forward", "pandar40-tripod": "backward"}


class Case(NamedTuple):
    """One run: a recording, its form, and what is stated of lens and board."""

    recording: str
    form: Form
    lens: bool
    size: bool

    @property
    def title(self) -> str:
        """Its name, which is that of its files and vehicle."""
        lens, size = "lens" if self.lens else "nolens", "size" if self.size else "open"
        return f"{self.recording}-{self.form}-{lens}-{size}"


def cases() -> list[Case]:
    """All of the recordings that are there."""
    return [
        Case(name, form, lens, size)
        for name in LENS_OF
        if (DATA / name).exists()
        for form in ("folder", "bag")
        for lens in (True, False)
        for size in (True, False)
    ]


def write(case: Case, folder: Path) -> Path:
    """Write the recording in its form, and return what is given to `apexcal solve`."""
    sweeps, frames = _read(case.recording)
    path = folder / case.title
    if case.form == "bag":
        _write_bag(path.with_suffix(".bag"), case, sweeps, frames)
        return path.with_suffix(".bag")
    (path / "clouds").mkdir(parents=True)
    (path / "images").mkdir()
    for index, (sweep, frame) in enumerate(zip(sweeps, frames, strict=True)):
        _write_pcd(path / "clouds" / f"{index:03}.pcd", sweep)
        (path / "images" / f"{index:03}.{frame.media_type.partition('/')[2]}").write_bytes(frame.data)
    if case.lens:
        (path / "camera_info.yaml").write_text(yaml.safe_dump(lens_document(case.recording, frames[0])))
    return path


def _read(name: str) -> tuple[list[Sweep], list[Frame]]:
    poses = RECORDINGS[name]
    options = ReadOptions(point_times="stamp_only", rings=poses.rings)
    opened = open_recording(DATA / (poses.path if poses.path.endswith(".bag") else name), options)
    try:
        (lidar,) = (s for s in opened.sensors if s.kind == "lidar")
        (camera,) = (s for s in opened.sensors if s.kind == "camera")
        return list(opened.sweeps(lidar)), list(opened.frames(camera))
    finally:
        opened.close()


def lens_document(name: str, frame: Frame) -> dict[str, Any]:
    """A recording's published lens as ROS's camera_calibration writes it."""
    info = _info(name, frame)
    return {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": "camera",
        "camera_matrix": {"rows": 3, "cols": 3, "data": list(info.K)},
        "distortion_model": info.distortion_model,
        "distortion_coefficients": {"rows": 1, "cols": len(info.D), "data": list(info.D)},
    }


def _info(name: str, frame: Frame) -> CameraEdit:
    lens = LENS_OF[name]
    values = dict(zip(INTRINSICS[lens.model], lens.intrinsics.tolist(), strict=True))
    K = (values["f_x"], 0.0, values["c_x"], 0.0, values["f_y"], values["c_y"], 0.0, 0.0, 1.0)
    D = tuple(values[term] for term in CAMERA_MODELS[lens.model].distortion) or (0.0,) * 5
    stated = CAMERA_MODELS[lens.model].written_as
    assert stated is not None
    return CameraEdit("front", "image_raw", "camera", frame.width, frame.height, stated.camera_info, K, D)


def _write_bag(path: Path, case: Case, sweeps: Sequence[Sweep], frames: Sequence[Frame]) -> None:
    info = _info(case.recording, frames[0]) if case.lens else None
    with BagWriter(path, "bag", "lidar", [CameraChannel("front", "camera", "image_raw", info)]) as bag:
        for sweep, frame in zip(sweeps, frames, strict=True):
            image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR)
            bag.write_sweep(sweep, sweep.stamp_ns)
            bag.write_picture("front", Picture(frame.stamp_ns, np.asarray(image)), frame.stamp_ns)


def _write_pcd(path: Path, sweep: Sweep) -> None:
    """A binary PCD of x y z intensity ring."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")]
    cloud = np.zeros(len(sweep.xyz), kinds)
    for axis, name in enumerate("xyz"):
        cloud[name] = sweep.xyz[:, axis]
    cloud["intensity"], cloud["ring"] = sweep.intensity, sweep.ring
    head = (
        "VERSION 0.7\nFIELDS x y z intensity ring\nSIZE 4 4 4 4 2\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n"
        f"WIDTH {len(cloud)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(cloud)}\nDATA binary\n"
    )
    path.write_bytes(head.encode() + cloud.tobytes())
