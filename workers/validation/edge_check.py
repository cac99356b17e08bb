"""Depth edges of a drive compared with its frames: the score, its curves, and where it would be highest.

The score is the mean image gradient across the edges over the gradients nearby. The idea is that of Levinson and
Thrun (Automatic online calibration of cameras and lasers, 2013); edges between rings and against nothing are added,
because without them no pitch shows.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.validations import TurnAxis
from workers.readers.recording import Sweep
from workers.validation.calibration import KnownCalibration
from workers.validation.edge_frames import UNIT, EdgeFrame
from workers.validation.motion import STANDING, Motion
from workers.validation.mount_search import ALL, APART_DEG, SHIFT, TURN, MountSearch
from workers.validation.mount_verdict import (
    CLEAR,
    FAR_DEG,
    FEWEST_PARTS,
    SHARED_DEG,
    MountVerdict,
    Summits,
    judge_mount,
)
from workers.validation.offsets import MOST_GROUPS, curve_offsets, group_mean, look_up

Floats = NDArray[np.float64]
_ONE_DEGREE: Final = np.radians([[0.0, 1.0, 0, 0, 0, 0], [0.0, -1.0, 0, 0, 0, 0]])
_LAST_STAGES: Final = 1
_TURNS: Final[tuple[TurnAxis, ...]] = ("pitch", "yaw")
_VERDICTS: Final = {"pass": "agrees", "not_told": "unknown", "look": "disagrees", "stop": "disagrees"}


class EdgeCheck:
    """Collects frames one by one; `verdict` and `result` say what they show together."""

    widest_px: Final = 1024
    """Frames that are wider are made smaller: a pixel is a tenth of a degree there, as far as columns are apart."""

    def __init__(self, calibration: KnownCalibration) -> None:
        self.calibration = calibration
        self.is_motion_told = True
        self._frames: list[EdgeFrame] = []

    def add(self, sweep: Sweep, image: NDArray[np.uint8], motion: Motion = STANDING) -> None:
        """A sweep and the frame (h, w), grey, of its moment, possibly made smaller, and how the LiDAR moves."""
        self._frames.append(EdgeFrame.of(self.calibration, sweep, image, motion))

    @cached_property
    def _summits(self) -> Summits | None:
        parts = sum(len(frame.parts(self.calibration).pixels) for frame in self._frames)
        if sum(len(frame.points) for frame in self._frames) < FEWEST_PARTS:
            return None
        search = MountSearch(self.calibration, self._frames)
        reached = [search.summit(start, TURN) for start in search.starts()]
        # From the deployed mount small steps lead to the nearest summit, large ones may lead past it.
        here = self.calibration
        reached.append(search.summit(here, TURN, _LAST_STAGES))
        turned = max(reached, key=lambda summit: float(summit.excess.sum()))
        apart_deg = search.apart_deg(here, turned.mount)
        others = {search.apart_deg(summit.mount, turned.mount): summit for summit in reached}
        rivals = {away: summit for away, summit in others.items() if away > APART_DEG}
        near = [summit for summit in rivals.values() if search.apart_deg(summit.mount, here) < FAR_DEG]
        # Places about as far off to the same side agree that the mount is far off, and leave open by how much.
        agreeing = {away: s for away, s in rivals.items() if apart_deg > FAR_DEG and 2.0 * away < apart_deg}
        left_deg = max((away for away, s in agreeing.items() if turned.lead_over(s) < CLEAR), default=0.0)
        far = [s for away, s in rivals.items() if away not in agreeing and not any(s is other for other in near)]
        return Summits(
            frames=len(self._frames), parts=parts, turned=turned, shifted=search.summit(here, SHIFT),
            moved=search.summit(turned.mount, ALL, _LAST_STAGES), aimed=search.summit(here, (0, 1), _LAST_STAGES),
            rolled=search.summit(here, (2,), _LAST_STAGES), near=near, far=far,
            apart_deg=apart_deg, left_deg=left_deg,
        )  # fmt: skip

    def verdict(self, lanes: dict[str, Any] | None = None) -> MountVerdict:
        """Return the verdict of the frames, and of lane markers if their result is given, on the mount."""
        return judge_mount(self._summits, len(self._frames), lanes, is_motion_told=self.is_motion_told)

    @property
    def score(self) -> float:
        """Return the score of the calibration as it is."""
        return float(self._scores(np.zeros((1, 6)))[0])

    def result(self) -> dict[str, Any]:
        """Return the document of a road score."""
        judged, summits = self.verdict(), self._summits
        along, curves = curve_offsets()
        score = self._scores(np.concatenate([along, np.zeros((1, 6)), _ONE_DEGREE]))
        start = 0
        for curve in curves:
            curve["score"] = np.round(score[start : start + len(curve["at"])], 4).tolist()
            start += len(curve["at"])
        parts = summits.parts if summits else 0
        document: dict[str, Any] = {"frames": len(self._frames), "parts": parts, "points": parts}
        document |= {
            "verdict": _VERDICTS[judged.verdict],
            "sentence": judged.sentence,
            "chance": 1.0,
            "curves": curves,
        }
        fits = all(axis.verdict == "pass" for axis in judged.axes[:2])
        if judged.verdict == "not_told" and fits:
            document["verdict"] = "agrees"
        if parts >= FEWEST_PARTS:
            document |= {"score": float(score[-3]), "score_at_one_degree": float(score[-2:].max())}
        if summits and (judged.verdict != "not_told" or any(axis.turn_deg is not None for axis in judged.axes)):
            for k, name in enumerate(_TURNS):
                sigma = np.hypot(np.sqrt(summits.turned.covariance[k, k]), np.radians(SHARED_DEG[name]))
                document[f"{name}_deg"] = float(np.degrees(summits.turned.offset[k]))
                document[f"sigma_{name}_deg"] = float(np.degrees(sigma))
        return document

    def _scores(self, offsets: Floats) -> Floats:
        """(K,) scores at offsets (K, 6) from the deployed mount."""
        sums, counts = np.zeros((len(offsets), MOST_GROUPS)), np.zeros((len(offsets), MOST_GROUPS))
        for frame in self._frames:
            parts = frame.parts(self.calibration)
            if len(parts.pixels):
                look_up(frame.maps, frame.scale, *parts, offsets, sums, counts)
        return group_mean(sums, counts) / UNIT
