"""Whether the board stays where it hides one part of the background, as the LiDAR sees it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workers.marks.sights import Floats, Sight


def is_in_one_place(sights: Sequence[Sight]) -> bool:
    """Whether boards hide the same direction in more than half of the frames, so that a median shows the board."""
    middles: list[Floats] = []
    radii: list[float] = []
    for sight in sights:
        ends = sight.neighbours("top")
        assert ends is not None
        middle = ends.mean(axis=0)  # of the diagonal between both ends, which is the rectangle's
        distance = float(np.linalg.norm(middle))
        middles.append(middle / distance)
        radii.append(0.5 * float(np.linalg.norm(ends - sight.corners["top"], axis=1).min()) / distance)
    unit = np.array(middles)
    angles = np.arccos(np.clip(unit @ unit.T, -1.0, 1.0))
    return bool((angles < np.array(radii)[None]).mean(axis=1).max() > 0.5)
