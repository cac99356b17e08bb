"""`python -m benchmarks.detection.still [RECORDINGS] [FIRST SEED]`: simulated still poses, by `suggest` alone.

Each recording is looked at in the suggested region and in one written by hand with walls inside, the board's size
known and open. A vertex more than 0.3 m off is gross. Boards that fewer than two rings meet do not count.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from apexcal.documents.errors import InputError
from benchmarks.detection.still_scenes import SETTINGS, Place, Recorded, drive, still_poses
from workers.geometry.spherical import to_xyz
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.suggestion import suggest

CASES: Final[tuple[tuple[Place, int, int], ...]] = (
    ("street", 8, 1),
    ("street", 8, 4),
    ("garage", 8, 1),
    ("room", 12, 1),
    ("street", 1, 1),
    ("garage", 1, 1),
    ("room", 1, 1),
)
_GROSS_M: Final = 0.3


@dataclass(slots=True)
class _Sum:
    boards: int = 0
    found: int = 0
    gross: int = 0
    off_mm: list[float] = field(default_factory=list[float])
    scaled: list[float] = field(default_factory=list[float])
    reasons: Counter[str] = field(default_factory=Counter[str])


def by_hand(place: Place, recorded: Recorded) -> Region:
    """1.5 m around the boards: walls and furniture are inside."""
    low, high = recorded.apex.min(axis=0) - 1.5, recorded.apex.max(axis=0) + np.array([1.5, 1.5, 0.5])
    low[2] = SETTINGS[place].ground_z + 0.1
    return Region.from_document({"box": {"min": low.tolist(), "max": high.tolist()}})


def add(total: _Sum, recorded: Recorded, region: Region | None, known: bool) -> None:
    """Detect in one recording, and count."""
    seen = {pose for pose, rings in zip(recorded.pose.tolist(), recorded.rings.tolist(), strict=True) if rings >= 2}
    total.boards += len(seen)
    if region is None:
        total.reasons["no suggestion"] += len(seen)
        return
    size = {"board_width_m": recorded.edges_m[0], "board_height_m": recorded.edges_m[1]} if known else {}
    found = detect_range(recorded.source, region, "refined", size, indices=range(len(recorded.sweeps)))
    total.reasons.update({name: n for name, n in found.rejected.items() if name != "same_pose"})
    for vertex in found.vertices:
        wrong = np.array(vertex.xyz) - recorded.apex[vertex.sweep_index]
        off = float(np.linalg.norm(wrong))
        total.gross += off > _GROSS_M
        total.found += off <= _GROSS_M
        if off <= _GROSS_M:
            total.off_mm.append(1e3 * off)
            covariance = to_xyz(np.array(vertex.covariance), np.array(vertex.xyz))
            total.scaled.append(float(wrong @ np.linalg.solve(covariance, wrong)) / 3.0)


def main() -> None:
    count, first = (int(text) for text in (*sys.argv[1:], *("4", "100")[len(sys.argv) - 1 :]))
    refused = 0
    for seed in range(first, first + count):
        try:
            suggest(drive(seed, 30))
        except InputError:
            refused += 1
    print(f"drives refused: {refused} of {count}")
    for place, poses, each in CASES:
        totals = {(where, known): _Sum() for where in ("suggested", "by hand") for known in (True, False)}
        for seed in range(first, first + count):
            recorded = still_poses(place, seed, poses, each=each)
            try:
                suggested = Region.from_document(suggest(recorded.source).document)
            except InputError:
                suggested = None
            for (where, known), total in totals.items():
                add(total, recorded, suggested if where == "suggested" else by_hand(place, recorded), known)
        for (where, known), total in totals.items():
            middle = float(np.median(total.off_mm)) if total.off_mm else np.nan
            chi = float(np.mean(total.scaled)) if total.scaled else np.nan
            reasons = ", ".join(f"{n} {name}" for name, n in total.reasons.items())
            print(
                f"{place}, {poses} poses of {each}, {where}, size {'known' if known else 'open'}: {total.found} of "
                f"{total.boards}, gross {total.gross}, median {middle:.0f} mm, chi-square {chi:.2f}; {reasons}",
                flush=True,
            )


if __name__ == "__main__":
    main()
