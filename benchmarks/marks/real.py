"""Real recordings: each frame's marks beside the published corners. Nothing of the machine was chosen by them.

Vertices are the product's own: suggested region, refined detector, the board's size stated.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from apexcal.documents.corners import CORNERS, CornerName
from apexcal.documents.readings import ReadOptions
from benchmarks.detection.real import DATA, DIAMOND, RECORDINGS, Floats, published
from benchmarks.marks.rendered import quantiles
from benchmarks.shares import share
from workers.geometry.spherical import to_xyz
from workers.marks.propose import propose
from workers.marks.sights import Image, Lens, MarkProposal, Sight
from workers.readers.detect import open_recording
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Vertex

# The published lenses. `pandar40-tripod` gave the deviation's floor and is not among them.
LENSES: Final = {
    DIAMOND: Lens(
        "kannala_brandt",
        np.array([1176.93, 1177.72, 962.275, 612.725, -0.0540096, -0.0784275, 0.0959641, -0.0515253]),
    ),
    "os1-64-board": Lens(
        "brown_conrady",
        np.array([2813.643275, 2808.326079, 969.285772, 624.049972, 0, -0.134313, -0.025905, 0.002181, 0.00084, 0]),
    ),
}


def tell_real() -> None:
    """Print how far each recording's marks are off, as far as the data are there."""
    for name, lens in LENSES.items():
        if not (DATA / name).exists():
            print(f"{name} is absent: it is looked for in ../shared/data")
            continue
        sights, frames = read(name)
        height, width = frames[0].shape
        marks = propose(frames, sights, (width, height), lens=lens, corners=CORNERS)
        marked = sum(any(isinstance(one, MarkProposal) for one in answer.values()) for answer in marks.answers)
        print(f"{name}: {marked} of {len(sights)} vertices marked ({len(frames)} frames)")
        if marks.failure is not None:
            print(f"   {marks.failure.sentence}")
        elif name == DIAMOND:
            poses = published()
            off = [
                float(np.hypot(*(np.array(mark.pixel) - poses[sight.frame][corner].uv)))
                for sight, answer in zip(sights, marks.answers, strict=True)
                for corner, mark in answer.items()
                if isinstance(mark, MarkProposal)
            ]
            print(f"   px from the published corners: {quantiles(off)}")
            print(f"   within 1 px {share(sum(one <= 1.0 for one in off), len(off))}")


def read(name: str) -> tuple[list[Sight], list[Image]]:
    """The detector's vertices as sights, and the frames; a frame has the number of its pose."""
    poses = RECORDINGS[name]
    opened = open_recording(DATA / poses.path, ReadOptions(point_times="stamp_only", rings=poses.rings))
    try:
        (lidar,) = (sensor for sensor in opened.sensors if sensor.kind == "lidar")
        source = Listed(list(opened.sweeps(lidar)))
        cameras = [sensor for sensor in opened.sensors if sensor.kind == "camera"]
        encoded = [frame.data for camera in cameras for frame in opened.frames(camera)]
    finally:
        opened.close()
    if not encoded:
        files = sorted((DATA / name / "images").iterdir(), key=lambda file: int(file.stem))
        encoded = [file.read_bytes() for file in files]
    frames = [np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)) for data in encoded]
    size = {"board_width_m": poses.width_m, "board_height_m": poses.height_m}
    region = Region.from_document(suggest(source, still=True).document)
    vertices = detect_range(source, region, "refined", size, indices=range(len(source)), still=True).vertices
    return [sight_of(vertex) for vertex in vertices], frames


def sight_of(vertex: Vertex) -> Sight:
    """A vertex whose frame has the number of its sweep."""
    xyz = np.array(vertex.xyz)
    corners: dict[CornerName, Floats] = {"top": xyz}
    if vertex.corners is not None:
        corners |= {name: np.array(at) for name, at in zip(vertex.corners.names, vertex.corners.xyz, strict=True)}
    covariance = to_xyz(np.array([vertex.covariance]), xyz[None])[0]
    return Sight(vertex.sweep_index, corners, covariance, vertex.roll[0] if vertex.roll else 0.0)
