"""Real recordings: each frame's mark beside the published one. Nothing of the machine was chosen by them.

Vertices are the product's own: suggested region, refined detector, the board's size stated.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from benchmarks.detection.real import DATA
from benchmarks.marks.figures import quantiles, share
from workers.geometry.models import ModelName
from workers.geometry.projection import project
from workers.geometry.spherical import to_xyz
from workers.marks.propose import propose
from workers.marks.sights import Image, Lens, MachineMarks, MarkProposal, Sight
from workers.readers.detect import open_recording
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Vertex

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RealRecording:
    """Still poses: clouds below the data's folder, the board's edges, the published lens, rings if not told."""

    clouds: str
    board_m: tuple[float, float]
    model: ModelName
    intrinsics: tuple[float, ...]
    rings: int | None = None


RECORDINGS: Final = {
    "vlp16-diamond-board": RealRecording(
        "vlp16-diamond-board/recording.bag",
        (0.61, 0.85),
        "kannala_brandt",
        (1176.93, 1177.72, 962.275, 612.725, -0.0540096, -0.0784275, 0.0959641, -0.0515253),
    ),
    "pandar40-tripod": RealRecording(
        "pandar40-tripod/clouds", (0.405, 0.648), "pinhole", (2525.9, 2528.1, 942.9102, 584.8342), 40
    ),
    "os1-64-board": RealRecording(
        "os1-64-board/clouds",
        (1.016, 1.016),
        "brown_conrady",
        (2813.643275, 2808.326079, 969.285772, 624.049972, 0.0, -0.134313, -0.025905, 0.002181, 0.000840, 0.0),
    ),
}


def tell_real() -> None:
    """Print each recording's differences, as far as the data are there."""
    for name, recording in RECORDINGS.items():
        if not (DATA / name).exists():
            print(f"{name} is absent: it is looked for in ../shared/data")
            continue
        sights, numbers, frames = read(name, recording)
        lens = Lens(recording.model, np.array(recording.intrinsics))
        height, width = frames[0].shape
        found = propose(frames, sights, (width, height), lens=lens, corners=("top", "left", "right", "bottom"))
        marked = sum(any(isinstance(one, MarkProposal) for one in answer.values()) for answer in found.answers)
        print(f"{name}: {marked} of {len(sights)} vertices marked ({len(frames)} frames)")
        if found.failure is not None:
            print(f"   {found.failure.sentence}")
            continue
        _compare(name, sights, numbers, found, lens)


def read(name: str, recording: RealRecording) -> tuple[list[Sight], list[int], list[Image]]:
    """The detector's vertices as sights, the number of the pose of each, and the frames."""
    opened = open_recording(DATA / recording.clouds, ReadOptions(point_times="stamp_only", rings=recording.rings))
    try:
        (lidar,) = (sensor for sensor in opened.sensors if sensor.kind == "lidar")
        source = Listed(list(opened.sweeps(lidar)))
        cameras = [sensor for sensor in opened.sensors if sensor.kind == "camera"]
        encoded = [frame.data for camera in cameras for frame in opened.frames(camera)]
    finally:
        opened.close()
    if encoded:
        frames = [cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) for data in encoded]
    else:
        files = sorted((DATA / name / "images").iterdir(), key=lambda file: int(file.stem))
        frames = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
    width_m, height_m = recording.board_m
    found = detect_range(
        source,
        Region.from_document(suggest(source, still=True).document),
        "refined",
        {"board_width_m": width_m, "board_height_m": height_m},
        indices=range(len(source)),
        still=True,
    )
    sights = [sight_of(vertex) for vertex in found.vertices]
    return sights, [vertex.sweep_index for vertex in found.vertices], frames


def sight_of(vertex: Vertex) -> Sight:
    """A vertex whose frame has the number of its sweep."""
    xyz = np.array(vertex.xyz)
    corners = {"top": xyz}
    if vertex.corners is not None:
        corners |= {name: np.array(at) for name, at in zip(vertex.corners.names, vertex.corners.xyz, strict=True)}
    covariance = to_xyz(np.array([vertex.covariance]), xyz[None])[0]
    return Sight(vertex.sweep_index, corners, covariance, vertex.roll[0] if vertex.roll else 0.0)


def _compare(name: str, sights: Sequence[Sight], numbers: Sequence[int], found: MachineMarks, lens: Lens) -> None:
    reference = _published(name) if name == "vlp16-diamond-board" else _extrapolated(name, lens)
    offs: list[Floats] = []
    for sight, number, answers in zip(sights, numbers, found.answers, strict=True):
        told: list[str] = []
        for corner, answer in answers.items():
            if not isinstance(answer, MarkProposal):
                told.append(f"{corner} {answer.reason}")
                continue
            near = _nearest(reference.get(number), np.array(answer.pixel))
            if near is None:
                u, v = answer.pixel
                told.append(f"{corner} at ({u:.1f}, {v:.1f}) +- {answer.sigma_px:.2f}")
                continue
            off = np.array(answer.pixel) - near
            offs.append(off)
            told.append(f"{corner} ({off[0]:+.2f}, {off[1]:+.2f})")
        print(f"   pose {number} (frame {sight.frame}): " + ", ".join(told))
    if offs:
        table = np.array(offs)
        distance = np.hypot(*table.T)
        rms = float(np.sqrt(np.mean(distance**2)))
        rest = float(np.sqrt(np.mean(np.sum((table - np.median(table, axis=0)) ** 2, axis=1))))
        print(f"   px from the reference: {quantiles(distance.tolist())}, RMS {rms:.2f}; {rest:.2f} about the median")
        print(f"   within 1 px {share(int(np.sum(distance <= 1.0)), len(distance))}")


def _nearest(places: Floats | None, pixel: Floats) -> Floats | None:
    """The reference's corner that a mark means: within 40 px, or none."""
    if places is None or not len(places):
        return None
    distance = np.hypot(*(places - pixel).T)
    return places[int(distance.argmin())] if distance.min() < 40.0 else None


def _published(name: str) -> Mapping[int, Floats]:
    """Corners (4, 2) by the number of the pose in the recording's order."""
    poses: dict[str, list[list[float]]] = {}
    with (DATA / name / "correspondences.csv").open() as file:
        for row in csv.DictReader(file):
            poses.setdefault(row["pose"], []).append([float(row["u"]), float(row["v"])])
    return {number: np.array(places) for number, places in enumerate(poses.values())}


def _extrapolated(name: str, lens: Lens) -> Mapping[int, Floats]:
    """Corners (4, 2) one square beyond the outermost inner corners of a chessboard of 7 x 4 of them."""
    if name != "pandar40-tripod":
        return {}
    found: dict[int, Floats] = {}
    files = sorted((DATA / name / "images").iterdir(), key=lambda file: int(file.stem))
    grid = np.array([(x, y, 0.0) for y in range(4) for x in range(7)], np.float64)
    beyond = np.array([(-1, -1, 0), (7, -1, 0), (7, 4, 0), (-1, 4, 0)], np.float64)
    K = np.array(
        [[lens.intrinsics[0], 0, lens.intrinsics[2]], [0, lens.intrinsics[1], lens.intrinsics[3]], [0, 0, 1]]
    )
    for number, file in enumerate(files):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        seen, corners = cv2.findChessboardCornersSB(
            image, (7, 4), flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
        )
        if not seen:
            continue
        _, turn, t = cv2.solvePnP(grid, np.asarray(corners, np.float64).reshape(-1, 2), K, None)
        in_camera = beyond @ np.asarray(cv2.Rodrigues(turn)[0]).T + np.asarray(t).ravel()
        found[number] = project(lens.model, lens.intrinsics, in_camera)[0]
    return found


if __name__ == "__main__":
    tell_real()
