"""`python -m benchmarks.detection.corners`: the corners of the real board, and calibrations from tips and from all.

The vertices are what `refined` finds in the 20 real poses (VLP-16, board of known size, region written by hand). The
marks are the published places of the four corners in the images. A calibration from the tips is compared with one
from all corners of the same poses. Both are tested on all corners of poses that neither saw. A second test is how far
the mounts of two halves of the poses differ.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CORNERS, TOP, CornerName
from apexcal.documents.fit_requests import fit_request
from apexcal.documents.pairs import SIGMAS
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, vector_from_rotation
from apexcal.geometry.se3 import SE3, from_document, to_document
from benchmarks.detection.real import DATA, RECORDINGS, angles, read, regions
from workers.geometry.projection import project
from workers.solver.blocks import blocks_of
from workers.solver.covariances import covariances_of
from workers.solver.held_out import folds
from workers.solver.outcomes import SolveError
from workers.solver.problem import fit_problem
from workers.solver.schedule import run_schedule
from workers.solver.solution import solve_finish
from workers.vertices.detectors import detect_range
from workers.vertices.vertex import Vertex

Floats = NDArray[np.float64]
Columns = dict[str, list[Any]]
NAME: Final = "vlp16-diamond-board"
# The publisher's lens (camera_info.yaml): equidistant, so that only the mount is open.
LENS: Final = {
    "f_x": 1176.93, "f_y": 1177.72, "c_x": 962.275, "c_y": 612.725,
    "k1": -0.0540096, "k2": -0.0784275, "k3": 0.0959641, "k4": -0.0515253,
}  # fmt: skip
REQUEST: Final = {
    "image_size": [1920, 1208],
    "nominal": to_document(SE3("camera", "velodyne", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3))),
    "weights": "covariances",
    "loss": "mean",
    "outliers": "keep",
    "schedule": {"slots": 1, "population": 300, "generations": 25, "max_iterations": 6},
}
# The published corners of the first pose lie off its points by 0.1 to 0.3 m, and so do its places in the image. It is
# left out of all figures.
WRONG_POSE: Final = 0
_FOLDS: Final = 5


class Labelled(NamedTuple):
    """A published corner: metres in the LiDAR frame, and pixels."""

    xyz: Floats
    pixel: Floats


class Held(NamedTuple):
    """Errors on all corners of poses that were held out, in px and in mm at the corner; pairs that were fitted."""

    px: Floats
    mm: Floats
    pairs: int


class Mounts(NamedTuple):
    """How far the mounts of two halves of the poses differ: each half every second pose."""

    degrees: float
    mm: float


def published() -> list[dict[CornerName, Labelled]]:
    """The corners of each pose by name. The file says which is the top; the others follow from where they lie."""
    with (DATA / NAME / "correspondences.csv").open() as file:
        rows = list(csv.DictReader(file))
    poses: list[dict[CornerName, Labelled]] = []
    for first in range(0, len(rows), 4):
        four = rows[first : first + 4]
        labels = [
            Labelled(np.array([float(row[k]) for k in "xyz"]), np.array([float(row[k]) for k in "uv"]))
            for row in four
        ]
        top = next(k for k, row in enumerate(four) if row["is_top"] == "1")
        bottom, *sides = sorted({0, 1, 2, 3} - {top}, key=lambda k: float(labels[k].xyz[2]))
        right, left = sorted(sides, key=lambda k: float(np.arctan2(labels[k].xyz[1], labels[k].xyz[0])))
        places = (top, left, right, bottom)
        poses.append({name: labels[place] for name, place in zip(CORNERS, places, strict=True)})
    return poses


def found_in(name: str = NAME) -> list[Vertex]:
    """What `refined` finds, with the board's size known and the region written by hand."""
    source, poses = read(name), RECORDINGS[name]
    size = {"board_width_m": poses.width_m, "board_height_m": poses.height_m}
    region = regions(name, source)["by hand"]
    found = detect_range(source, region, "refined", size, indices=range(len(source)), still=True)
    return [vertex for vertex in found.vertices if vertex.sweep_index != WRONG_POSE]


def corners_of(vertex: Vertex) -> dict[CornerName, tuple[Floats, Floats]]:
    """Place and covariance of each corner, the tip among them."""
    known = vertex.corners
    assert known is not None
    joint, places = np.array(known.covariance), [vertex.xyz, *known.xyz]
    return {
        name: (np.array(places[k]), joint[3 * k : 3 * k + 3, 3 * k : 3 * k + 3])
        for k, name in enumerate((TOP, *known.names))
    }


def compared(vertices: Sequence[Vertex], poses: Sequence[dict[CornerName, Labelled]]) -> dict[CornerName, Floats]:
    """(N, 2) of each corner: distance to the published one in metres, and its squared error over what is stated.

    The latter over 3, and the publisher's own error is not allowed for.
    """
    found: dict[CornerName, list[tuple[float, float]]] = {name: [] for name in CORNERS}
    for vertex in vertices:
        for name, (xyz, covariance) in corners_of(vertex).items():
            truth = poses[vertex.sweep_index][name].xyz
            off = angles(xyz) - angles(truth)
            chi = float(off @ np.linalg.solve(covariance, off)) / 3.0
            found[name].append((float(np.linalg.norm(xyz - truth)), chi))
    return {name: np.array(rows) for name, rows in found.items()}


def pairs_of(
    vertices: Sequence[Vertex], poses: Sequence[dict[CornerName, Labelled]], names: Sequence[CornerName]
) -> Columns:
    """Columns of pairs, as a set has them: the corners of one pose are a group."""
    columns: Columns = {name: [] for name in ("x", "y", "z", "u", "v", "group", *SIGMAS)}
    for vertex in vertices:
        for name, (xyz, covariance) in corners_of(vertex).items():
            if name in names:
                pixel = poses[vertex.sweep_index][name].pixel
                row = (*xyz.tolist(), *pixel.tolist(), vertex.sweep_index, *np.sqrt(np.diag(covariance)).tolist())
                for column, value in zip(columns.values(), row, strict=True):
                    column.append(value)
    return columns


def solved(pairs: Columns, chosen: Sequence[int], model: str, *, locked: bool) -> dict[str, Any]:
    """The solver's answer for some pairs; ``locked``: with the publisher's lens."""
    taken = {name: [values[row] for row in chosen] for name, values in pairs.items()}
    points = np.column_stack([taken[axis] for axis in "xyz"])
    request = REQUEST | {"model": model} | ({"locked": LENS} if locked else {})
    covariances = covariances_of({name: taken[name] for name in SIGMAS}, points, 1.0)
    problem = fit_problem(
        fit_request(**request), points, np.column_stack([taken["u"], taken["v"]]), covariances=covariances
    )
    blocks = blocks_of(taken)
    problem = replace(problem, blocks=blocks)
    return solve_finish(problem, run_schedule(problem)[0]).model_dump(mode="json", exclude_unset=True)


def off_the_image(pairs: Columns) -> Floats:
    """(N,) millimetres at the board by which corners miss their places in the image, with the published lens.

    The mount is fitted to the same corners: six numbers.
    """
    mount = from_document(solved(pairs, range(len(pairs["x"])), "kannala_brandt", locked=True)["transform"])
    there = mount.apply(np.column_stack([pairs[axis] for axis in "xyz"]))
    projected, _ = project("kannala_brandt", LENS, there)
    off = np.linalg.norm(projected - np.column_stack([pairs["u"], pairs["v"]]), axis=1)
    return 1e3 * off * np.linalg.norm(there, axis=1) / LENS["f_x"]


def as_published(pairs: Columns, poses: Sequence[dict[CornerName, Labelled]]) -> Columns:
    """Pairs of tips with the published tips instead of those that were found."""
    xyz = np.array([poses[pose][TOP].xyz for pose in pairs["group"]])
    return pairs | dict(zip("xyz", xyz.T.tolist(), strict=True))


def held_out(pairs: Columns, judges: Columns, model: str, *, locked: bool) -> Held:
    """Fit to the poses of all folds but one, and test on all corners (`judges`) of the poses of that one."""
    group, judged = np.array(pairs["group"]), np.array(judges["group"])
    points = np.column_stack([judges[axis] for axis in "xyz"])
    marks = np.column_stack([judges["u"], judges["v"]])
    px, mm = [], []
    for fold in folds(np.array(judges["group"]), _FOLDS):
        left_out = judged[fold.indices]
        answer = solved(pairs, np.flatnonzero(~np.isin(group, left_out)).tolist(), model, locked=locked)
        lens, mount = answer["intrinsics"], from_document(answer["transform"])
        there = mount.apply(points[fold.indices])
        projected, _ = project(lens["model"], lens, there)
        off = np.linalg.norm(projected - marks[fold.indices], axis=1)
        px += off.tolist()
        mm += (1e3 * off * np.linalg.norm(there, axis=1) / lens["f_x"]).tolist()
    return Held(np.array(px), np.array(mm), len(group))


def halves(pairs: Columns, model: str, *, locked: bool) -> Mounts:
    """The mounts of every second pose and of the others."""
    group = np.array(pairs["group"])
    rank = np.searchsorted(np.unique(group), group)
    one, other = (
        from_document(solved(pairs, np.flatnonzero(rank % 2 == half).tolist(), model, locked=locked)["transform"])
        for half in (0, 1)
    )
    turned = float(np.degrees(np.linalg.norm(vector_from_rotation(one.R @ other.R.T))))
    return Mounts(turned, 1e3 * float(np.linalg.norm(one.R.T @ one.t - other.R.T @ other.t)))


def main() -> None:
    if not (DATA / NAME).exists():
        print(f"{NAME} is absent: it is looked for in ../shared/data")
        return
    vertices, poses = found_in(), published()
    for name, rows in compared(vertices, poses).items():
        off, chi = rows.T
        print(
            f"{name}: {len(rows)} corners, median {1e3 * np.median(off):.0f} mm, worst {1e3 * off.max():.0f} mm from "
            f"the published ones, chi-square {chi.mean():.2f} (median {np.median(chi):.2f})"
        )
    tips = pairs_of(vertices, poses, (TOP,))
    for whose, pairs in (("found", tips), ("published", as_published(tips, poses))):
        off = off_the_image(pairs)
        print(f"tips {whose}: {np.sqrt(np.mean(off**2)):.1f} mm (RMS) beside the tips in the images")
    judges = pairs_of(vertices, poses, CORNERS)
    for model, locked in (("kannala_brandt", True), ("kannala_brandt", False), ("brown_conrady", False)):
        print(f"{model}, {'the published lens, mount open' if locked else 'lens and mount open'}")
        for title, names in (("tips", (TOP,)), ("all corners", CORNERS)):
            pairs = pairs_of(vertices, poses, names)
            print(f"   {title}: {_held_in_words(pairs, judges, model, locked=locked)}")
            print(f"      {_halves_in_words(pairs, model, locked=locked)}")


def _held_in_words(pairs: Columns, judges: Columns, model: str, *, locked: bool) -> str:
    try:
        held = held_out(pairs, judges, model, locked=locked)
    except SolveError as error:
        return str(error)
    seen = np.isfinite(held.px)
    px, mm = held.px[seen], held.mm[seen]
    unseen = "" if seen.all() else f"; {np.count_nonzero(~seen)} of {seen.size} lie where the lens has no image"
    return (
        f"{held.pairs} pairs; held-out corners median {np.median(px):.1f} px, mean {px.mean():.1f} px, "
        f"worst {px.max():.0f} px; median {np.median(mm):.1f} mm at the board{unseen}"
    )


def _halves_in_words(pairs: Columns, model: str, *, locked: bool) -> str:
    try:
        apart = halves(pairs, model, locked=locked)
    except SolveError as error:
        return str(error)
    return f"mounts of two halves of the poses: {apart.degrees:.2f} degrees and {apart.mm:.0f} mm apart"


if __name__ == "__main__":
    main()
