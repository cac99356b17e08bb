"""The track: the apex between the sweeps, as a smooth path through the vertices near a moment, with its covariance.

A person's motion is modelled as an integrated Wiener process: a velocity that wanders, as strongly as the vertices
themselves show. The posterior mean is then a smoothing spline, and its covariance counts both the vertices' errors
and how far the person may have strayed between them (Wahba 1978, "Improper priors, spline smoothing"; Särkkä and
Solin, "Applied Stochastic Differential Equations", ch. 12). The result at a moment depends only on the vertices of
:data:`MARGIN_SWEEPS` sweeps on either side, so it does not depend on how a recording is cut into shards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.errors import InputError
from workers.geometry.spherical import axes, to_spherical, to_xyz
from workers.vertices.vertex import LASTING_S, Vertex, noise_of

Floats = NDArray[np.float64]

MARGIN_SWEEPS: Final = 10
_SLOTS: Final = 15  # vertices nearest in time that are used; farther ones hardly count
# Spectral density of the acceleration, m^2/s^3, from a board held still to a jerk; the vertices weigh them. Along
# azimuth, elevation and range: a walker bobs at every step, even where the vertices are too coarse to show it.
_GRID: Final = np.array([0.001, 0.01, 0.1, 1.0, 10.0])
_WANDER: Final = np.stack([_GRID, np.maximum(_GRID, 0.1), _GRID])
_BRISK: Final = 2  # the density under which outliers are sought
_OFF_TRACK: Final = 30.0  # squared standard score of three numbers: chance one in a million
_MOST_OFF: Final = 4
_BEFORE: Final = np.diag([1e-8, 1.2**-2])  # precision of position and velocity (1.2 m/s) before any vertex
_ABSENT: Final = 1e3  # standard deviation, metres, of a slot without a vertex
_CHUNK: Final = 128


@dataclass(frozen=True, slots=True, eq=False)
class TrackPoints:
    """The track at M moments.

    Attributes:
        xyz: (M, 3) the apex, metres, LiDAR frame.
        velocity: (M, 3) metres per second.
        covariance: (M, 3, 3) of the apex over (azimuth rad, elevation rad, range m), interpolation included.
        covariance_xyz: (M, 3, 3) the same, over x, y, z, square metres.
        gap_ns: (M,) int64 from the nearest, in time, of the vertices that the local window holds.
    """

    xyz: Floats
    velocity: Floats
    covariance: Floats
    covariance_xyz: Floats
    gap_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Vertices of one walk in the order of their times.

    Attributes:
        times_ns: (N,) int64, when each vertex point was measured, LiDAR clock.
        sweep: (N,) int64, number of the sweep in its recording.
        xyz: (N, 3) metres, LiDAR frame.
        covariance: (N, 3, 3) over x, y, z, square metres: what differs from sweep to sweep.
        common: (N, 3) standard deviations over (azimuth rad, elevation rad, range m) of the error that neighbouring
            vertices share and smoothing does not remove.
        lasting: (N, 3) share of the variances, along the same axes, that lasts for some sweeps.
    """

    times_ns: NDArray[np.int64]
    sweep: NDArray[np.int64]
    xyz: Floats
    covariance: Floats
    common: Floats
    lasting: Floats

    @classmethod
    def of(cls, vertices: Sequence[Vertex]) -> Self:
        """Return the track of vertices in any order; those without a covariance get that of their detector."""
        ordered = sorted(vertices, key=lambda vertex: (vertex.time_ns, vertex.sweep_index))
        xyz = np.array([vertex.xyz for vertex in ordered], np.float64).reshape(-1, 3)
        own, common, lasting = noise_of(ordered)
        return cls(
            times_ns=np.array([vertex.time_ns for vertex in ordered], np.int64),
            sweep=np.array([vertex.sweep_index for vertex in ordered], np.int64),
            xyz=xyz,
            covariance=to_xyz(own, xyz),
            common=common,
            lasting=lasting,
        )

    def places(self, vertices: Sequence[Vertex]) -> NDArray[np.int64]:
        """Return (M,) the indices of some of the track's vertices in it."""
        index = {
            (time, sweep): i
            for i, (time, sweep) in enumerate(zip(self.times_ns.tolist(), self.sweep.tolist(), strict=True))
        }
        return np.array([index[vertex.time_ns, vertex.sweep_index] for vertex in vertices], np.int64)

    def at(self, times_ns: ArrayLike, centre: ArrayLike | None = None) -> TrackPoints:
        """Return the track at moments of the LiDAR's clock.

        Args:
            times_ns: (M,) nanoseconds; before the first and after the last vertex the track is continued.
            centre: (M,) index of the vertex about whose sweep the local window lies; None: the nearest in time.

        Raises:
            InputError: ``track_empty``, there is no vertex.
        """
        if not len(self.times_ns):
            raise InputError("track_empty", "There is no corner to lay a track through.", "Widen the region.")
        times = np.asarray(times_ns, np.int64).reshape(-1)
        nearest = self._nearest(times)
        about = nearest if centre is None else np.asarray(centre, np.int64).reshape(-1)
        parts = [
            self._local(times[first : first + _CHUNK], about[first : first + _CHUNK])
            for first in range(0, len(times), _CHUNK)
        ]
        none = np.zeros((0, 3, 3))
        xyz = np.concatenate([none[:, 0], *(part[0] for part in parts)])
        spread = np.concatenate([none, *(part[2] for part in parts)])
        return TrackPoints(
            xyz=xyz,
            velocity=np.concatenate([none[:, 0], *(part[1] for part in parts)]),
            covariance=to_spherical(spread, xyz),
            covariance_xyz=spread,
            gap_ns=self._gap(times, about),
        )

    def _gap(self, times: NDArray[np.int64], about: NDArray[np.int64]) -> NDArray[np.int64]:
        chosen, _ = self._near(times, about)
        return np.abs(self.times_ns[chosen[:, 0]] - times)

    def _nearest(self, times: NDArray[np.int64]) -> NDArray[np.int64]:
        after = np.clip(np.searchsorted(self.times_ns, times), 0, len(self.times_ns) - 1)
        before = np.maximum(after - 1, 0)
        take_before = np.abs(times - self.times_ns[before]) <= np.abs(self.times_ns[after] - times)
        return np.where(take_before, before, after)

    def _local(self, times: NDArray[np.int64], about: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
        """Return position (M, 3), velocity (M, 3) and covariance of the position (M, 3, 3) at a few moments."""
        chosen, present = self._near(times, about)
        origin = self.xyz[about]
        # Along azimuth, elevation and range the vertices' errors and the walk's wandering are nearly independent.
        turn = axes(origin)
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        back = turn.swapaxes(-1, -2)[:, None]
        t = (self.times_ns[chosen] - times[:, None]).astype(np.float64) * 1e-9
        y = (back @ (self.xyz[chosen] - origin[:, None])[..., None])[..., 0]
        noise = back @ self.covariance[chosen] @ back.swapaxes(-1, -2)
        shared = np.einsum("mnai,mnia->mna", back, axes(self.xyz[chosen])) * self.common[chosen]
        lasting = self.lasting[chosen]
        window = _Window.of(t, y, noise, shared, lasting, present)
        for _ in range(_MOST_OFF):
            off = _off_track(window, present)
            if not off.any():
                break
            present = present & ~off
            window = _Window.of(t, y, noise, shared, lasting, present)
        p, v, spread = _posterior(window, noise)
        return (
            origin + (turn @ p[..., None])[..., 0],
            (turn @ v[..., None])[..., 0],
            turn @ spread @ turn.swapaxes(-1, -2),
        )

    def _near(
        self, times: NDArray[np.int64], about: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return indices (M, n) of the vertices that count at each moment, and which of these exist."""
        reach = np.arange(-MARGIN_SWEEPS, MARGIN_SWEEPS + 1)
        position = about[:, None] + reach
        index = np.clip(position, 0, len(self.times_ns) - 1)
        near = (position == index) & (np.abs(self.sweep[index] - self.sweep[about][:, None]) <= MARGIN_SWEEPS)
        away = np.where(near, np.abs(self.times_ns[index] - times[:, None]), np.iinfo(np.int64).max)
        order = np.argsort(away, axis=1, kind="stable")[:, :_SLOTS]
        return np.take_along_axis(index, order, 1), np.take_along_axis(near, order, 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """The linear model of the n vertices near each of M moments, for 3 axes and the Q densities `_WANDER`.

    Attributes:
        H: (M, 1, 1, n, 2) design matrix of position and velocity at the moment itself.
        y: (M, 3, 1, n, 1) the vertices, metres from the origin.
        S: (M, 3, Q, n, n) covariance of the vertices about a straight walk.
    """

    H: Floats
    y: Floats
    S: Floats

    @classmethod
    def of(
        cls, t: Floats, y: Floats, noise: Floats, shared: Floats, lasting: Floats, present: NDArray[np.bool_]
    ) -> Self:
        """Return the model; t (M, n) seconds after the moment, y and the others (M, n, 3), noise (M, n, 3, 3)."""
        t, y, shared = t * present, y * present[..., None], shared * present[..., None]
        own = np.where(present[..., None], np.einsum("mnaa->mna", noise), _ABSENT**2).swapaxes(1, 2)
        a, b = np.abs(t)[:, :, None], np.abs(t)[:, None, :]
        low, high = np.minimum(a, b), np.maximum(a, b)
        # Given position and velocity at the moment, past and future are independent.
        same_side = t[:, :, None] * t[:, None, :] > 0.0
        strayed = np.where(same_side, low * low * (0.5 * high - low / 6.0), 0.0)
        common = shared.swapaxes(1, 2)
        lasts = np.sqrt(own * np.where(present[..., None], lasting, 0.0).swapaxes(1, 2))
        fades = np.exp(-np.abs(t[:, :, None] - t[:, None, :]) / LASTING_S)[:, None]
        fixed = common[..., :, None] * common[..., None, :] + lasts[..., :, None] * lasts[..., None, :] * fades
        fixed += (own - lasts * lasts)[..., None] * np.eye(t.shape[1])
        return cls(
            H=np.stack([np.ones_like(t), t], axis=-1)[:, None, None],
            y=y.swapaxes(1, 2)[:, :, None, :, None],
            S=fixed[:, :, None] + _WANDER[:, :, None, None] * strayed[:, None, None],
        )


def _off_track(window: _Window, present: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (M, n) each moment's worst vertex, if it disagrees grossly with all others."""
    H, y = window.H[:, :, 0], window.y[:, :, 0]
    W = np.linalg.inv(window.S[:, :, _BRISK])
    WH = W @ H
    P = W - WH @ np.linalg.inv(H.swapaxes(-1, -2) @ WH + _BEFORE) @ WH.swapaxes(-1, -2)
    pull = (P @ y)[..., 0]
    # Squared standard score of a vertex as predicted from all others (leave-one-out of a Gaussian process).
    score = np.sum(pull * pull / np.diagonal(P, axis1=-2, axis2=-1), axis=1)
    score = np.where(present & (present.sum(axis=1, keepdims=True) > 3), score, 0.0)
    off = np.zeros(score.shape, np.bool_)
    moment, worst = np.arange(len(score)), np.argmax(score, axis=1)
    off[moment, worst] = score[moment, worst] > _OFF_TRACK
    return off


def _posterior(window: _Window, noise: Floats) -> tuple[Floats, Floats, Floats]:
    """Return position (M, 3), velocity (M, 3) and position's covariance (M, 3, 3), averaged over the densities."""
    H, y, S = window.H, window.y, window.S
    inverse = np.linalg.inv(S)
    WH = inverse @ H
    C = np.linalg.inv(H.swapaxes(-1, -2) @ WH + _BEFORE)
    gain = C @ WH.swapaxes(-1, -2)  # (M, 3, Q, 2, n)
    x = gain @ y
    misfit = (y * (inverse @ y)).sum(axis=(-1, -2)) - (x * (WH.swapaxes(-1, -2) @ y)).sum(axis=(-1, -2))
    evidence = -0.5 * (misfit + np.linalg.slogdet(S)[1] - np.linalg.slogdet(C)[1])
    weight = np.exp(evidence - evidence.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)  # (M, 3, Q)
    mean = np.einsum("maq,maqi->mai", weight, x[..., 0])
    apart = x[..., 0, 0] - mean[..., None, 0]
    variance = np.einsum("maq,maq->ma", weight, C[..., 0, 0] + apart * apart)
    # The correlation of the vertices' errors between axes passes through the same gains.
    pull = np.einsum("maq,maqn->man", weight, gain[..., 0, :])
    spread = np.einsum("man,mnab,mbn->mab", pull, noise, pull)
    axis = np.arange(3)
    spread[:, axis, axis] = variance
    return mean[..., 0], mean[..., 1], spread
