"""Vertices of simulated walks with errors of known size, and where the apex truly was."""

import numpy as np

from workers.geometry.spherical import axes
from workers.simulation.walker import Walk
from workers.vertices.vertex import Vertex

START_NS = 1_780_000_000_000_000_000
SIGMA = np.array([np.radians(0.05), np.radians(0.03), 0.011])


def seconds(times_ns):
    return (np.asarray(times_ns) - START_NS) * 1e-9


def walk(seed, length_s=30.0, plan="field"):
    return Walk(seed, length_s, -1.85, plan=plan)


def vertices(way, seed, length_s=30.0, *, share=0.8, sigma=SIGMA, wrong=0.0, stated=True):
    """Ten sweeps a second, ``share`` of them with a vertex; of these ``wrong`` are off by half a degree."""
    random = np.random.default_rng(seed)
    at = np.arange(0.3, length_s - 0.3, 0.1)
    sweep = np.flatnonzero(random.random(at.size) < share)
    times = START_NS + np.round(at[sweep] * 1e9).astype(np.int64)
    apex = way.poses(seconds(times)).apex
    error = random.normal(size=apex.shape) * sigma
    if stated:  # what the sweeps around tell of the board's roll errs alike for some sweeps
        fades = np.exp(-np.abs(at[sweep][:, None] - at[sweep]) / 0.3)
        lasting = np.linalg.cholesky(fades + 1e-9 * np.eye(len(sweep))) @ random.normal(size=len(sweep))
        error[:, 0] = np.sqrt(0.6) * error[:, 0] + np.sqrt(0.4) * lasting * sigma[0]
    gross = random.random(len(apex)) < wrong
    error[gross, :2] += np.radians(random.choice([-0.5, 0.5], (int(gross.sum()), 2)))
    xyz = apex + np.einsum("nij,nj->ni", axes(apex), error)
    covariance = tuple(tuple(row) for row in np.diag(np.square(sigma)).tolist()) if stated else None
    return [
        Vertex(tuple(p), int(t), 5, int(s), 9, "refined" if stated else "strict", covariance)
        for p, t, s in zip(xyz.tolist(), times, sweep, strict=True)
    ]


def spherical(xyz):
    flat = np.hypot(xyz[:, 0], xyz[:, 1])
    return np.column_stack(
        [np.arctan2(xyz[:, 1], xyz[:, 0]), np.arctan2(xyz[:, 2], flat), np.linalg.norm(xyz, axis=1)]
    )
