"""What the pairs do not determine, in sentences: points without extent, parameters that correlate or stay open."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.polish import distances
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.uncertainty import Uncertainty

Floats = NDArray[np.float64]
# Extent of the points across a line or plane, relative to along it, below which they count as lying in it: as flat
# as marks of a pixel and ranges of a centimetre can tell at the distances people walk.
_FLAT: Final = 1e-3
_COINCIDENT_M: Final = 1e-3
_PLANE: Final = "all lie in one plane"
_EXTRINSICS: Final = 6
_CONFUSED: Final = 0.98
# Standard deviations above which a parameter is as good as unknown. Those of f and c count in image widths.
_VAGUE: Final = {"deg": 1.0, "m": 0.1, "px": 0.02, "1": 0.1}
# And those above which the value found is arbitrary, unless the bounds alone say more.
_ARBITRARY: Final = {"deg": 10.0, "m": 1.0, "px": 0.2}


def is_determined(problem: FitProblem, p: Floats, spread: Uncertainty) -> bool:
    """Whether the pairs determine every free parameter, with at least one pair that the camera can see."""
    return not arbitrary(problem, spread) and bool(np.any(_seen(problem, p)))


def arbitrary(problem: FitProblem, spread: Uncertainty) -> dict[str, float]:
    """The free parameters that the pairs leave open, with their deviations in people's units (or infinite)."""
    width = (problem.upper - problem.lower)[problem.free]
    found: dict[str, float] = {}
    for name, unit, std, room in zip(spread.names, spread.units, spread.std.tolist(), width.tolist(), strict=True):
        limit = _ARBITRARY.get(unit, np.inf) * (problem.image_size[0] if unit == "px" else 1.0)
        if not np.isfinite(std) or min(std, np.degrees(room) if unit == "deg" else room) > limit:
            found[name] = std
    return found


def point_alarms(problem: FitProblem, p: Floats) -> list[str]:
    """Sentences on the points' extent, and on points that no camera at p (D,) could see."""
    used = problem.weights > 0.0
    found: list[str] = []
    unseen = int(np.count_nonzero(used & ~_seen(problem, p)))
    if unseen == np.count_nonzero(used):
        found.append(
            "All points lie behind the camera or past the lens model's range, wherever the search looked: check the "
            "nominal rotation, widen the range of rotations to 180 degrees, and check which way the frames are named."
        )
    elif unseen:
        found.append(
            f"{unseen} pairs lie behind the camera or past the lens model's range, or an image away: "
            "check those marks, the nominal rotation and the model."
        )
    different = len(np.unique(problem.points[used], axis=0))
    if 1 < different < 0.5 * len(problem.free):
        found.append(
            f"The pairs are of {different} different vertices only, with {len(problem.free)} free parameters: mark "
            "vertices at more places, or lock what is known."
        )
    shape = _shape(problem.points[used])
    # A plane holds a camera whose lens is known.
    if shape and not (shape == _PLANE and problem.free.max(initial=0) < _EXTRINSICS):
        found.append(
            f"The vertices {shape}, which cannot hold a camera's position and lens together: "
            "mark vertices at other heights and distances, or lock the intrinsics."
        )
    return found


def parameter_alarms(problem: FitProblem, p: Floats, spread: Uncertainty) -> list[str]:
    """Sentences on parameters that the pairs do not determine, determine poorly, or cannot tell apart."""
    found: list[str] = []
    lost = [name for name, std in zip(spread.names, spread.std.tolist(), strict=True) if not np.isfinite(std)]
    if lost:
        found.append(
            f"The pairs do not determine {', '.join(lost)} (rank {spread.rank} of {len(spread.names)}): "
            "mark vertices at other distances and image regions, or lock parameters."
        )
    vague = [
        f"{name} {std:.2g} {unit}".removesuffix(" 1")
        for name, unit, std in zip(spread.names, spread.units, spread.std.tolist(), strict=True)
        if np.isfinite(std) and std > _VAGUE[unit] * (problem.image_size[0] if unit == "px" else 1.0)
    ]
    if vague:
        found.append(
            f"The pairs determine {', '.join(vague)} poorly (one standard deviation): the data does not determine "
            f"all {len(spread.names)} parameters. More pairs across the image and the distances, locked intrinsics "
            "or a smaller model make it better."
        )
    worst = spread.worst_correlation()
    if worst is not None and abs(worst.value) > _CONFUSED:
        one, other = worst.pair
        found.append(
            f"{_word(one)} and {_word(other)} can hardly be told apart (correlation {worst.value:.3f}): trust "
            f"their combination, not each alone; {_advice(problem, p, one, other)}."
        )
    return found


def _seen(problem: FitProblem, p: Floats) -> NDArray[np.bool_]:
    return distances(problem, p) < problem.diagonal_px


def _shape(points: Floats) -> str:
    centred = points - points.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False) / np.sqrt(len(points))
    if extent[0] < _COINCIDENT_M:
        return "all lie in one place"
    if extent[1] < _FLAT * extent[0]:
        return "all lie on one line"
    return _PLANE if extent[2] < _FLAT * extent[0] else ""


def _word(name: str) -> str:
    words = {
        "f_x": "focal length", "f_y": "focal length", "t_x": "sideways offset", "t_y": "height",
        "t_z": "forward offset", "rotation_x": "pitch", "rotation_y": "yaw", "rotation_z": "roll",
        "c_x": "principal point", "c_y": "principal point",
    }  # fmt: skip
    return f"{words[name]} ({name})" if name in words else name


def _advice(problem: FitProblem, p: Floats, first: str, second: str) -> str:
    pair = {first, second}
    if pair & {"t_x", "t_y", "t_z"}:
        # Parallax tells an offset from everything else, and falls with the distance.
        depth = transform_of(problem, p).apply(problem.points[problem.weights > 0.0])[:, 2]
        return f"mark vertices nearer than {max(1.0, float(np.round(0.5 * np.median(depth)))):.0f} m"
    if pair & {"c_x", "c_y"}:
        return "mark vertices towards all edges of the image, or lock the principal point"
    if any(name.startswith("k") for name in pair):
        return "mark vertices towards the corners of the image, or lock a distortion term"
    return "locking one of them fixes the other"
