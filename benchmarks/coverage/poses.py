"""Poses of a still board, each corner marked again and again, as public recordings of tripods have them."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.coverage.walks import CORNERS, Paired
from workers.geometry.spherical import axes

PAIRS: Final = 210


def still(paired: Paired, poses: int) -> Paired:
    """The board of a walk in a few of its places where all its corners are seen, as 210 pairs in all.

    Each vertex has errors of its own, of the size that the detector states at that place.
    """
    corner = np.arange(PAIRS // poses) % CORNERS
    whole = np.ones(len(paired.taken_ns), np.bool_)
    for one in range(CORNERS):
        places = replace(paired, corner=np.full(len(paired.corner), one)).places(paired.taken_ns)
        whole &= paired.camera.sees(paired.camera.project(places))
    seen = np.flatnonzero(whole)
    chosen = seen[np.round((np.arange(poses) + 0.5) / poses * len(seen)).astype(np.int64)]
    rows = np.repeat(chosen, len(corner))
    posed = replace(
        paired,
        sigmas=paired.sigmas[rows],
        taken_ns=paired.taken_ns[rows],
        stamps_ns=paired.stamps_ns[rows],
        sweeps=paired.sweeps[rows],
        frames=paired.frames[rows],
        corner=np.tile(corner, poses),
        pose=np.repeat(np.arange(poses), len(corner)),
    )
    random = np.random.default_rng([paired.walked.rig.options.seed, 47])
    places = posed.places(posed.taken_ns)
    noise = posed.sigmas * random.normal(size=places.shape)
    return replace(posed, xyz=places + np.einsum("nij,nj->ni", axes(places), noise))
