"""Grey levels across a board's edge in a frame, and the edges that each profile shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.marks.sights import Floats, Image

WIDEST_PX: Final = 32.0
SHORTEST_PX: Final = 10.0  # of an edge, without its ends
SHARPEST_PX: Final = 1.0  # standard deviation of the derivative of a Gaussian
SOFTEST_PX: Final = 4.0
STEP_PX: Final = 0.5
_TIP_PX: Final = 6.0  # left out at the corner, which is blunt; more for large boards
_TIP_SHARE: Final = 0.05
_END_SHARE: Final = 0.06  # left out at the far end
_MOST_PROFILES: Final = 64
_CANDIDATES: Final = 3  # edges of a profile
_NOISES: Final = 4.0
_CROP_PX: Final = 24

Curve = Callable[[Floats], Floats]
"""Pixels (K, 2) of a board's edge at shares (K,) of its length from the corner."""


class ProfileEdges(NamedTuple):
    """The strongest edges of P profiles, C of each.

    Attributes:
        offsets: (P, C) px from the projection; not a number where a profile has fewer.
        share: (P, C) root of the strength against the profile's strongest edge. A profile agrees with a line by
            this share. Counting every edge alike, lines through mere texture reach `AGREEING` by chance.
        curvature: (P, C) of the filter's response at its peak, relative to it, 1 / px^2.
    """

    offsets: Floats
    share: Floats
    curvature: Floats


@dataclass(frozen=True, eq=False)
class TracedEdge:
    """An edge in the image at P places: pixels (P, 2), unit normals (P, 2), lengths along it from the corner (P,)."""

    pixels: Floats
    normals: Floats
    along: Floats
    length: float

    @property
    def hidden_share(self) -> float:
        """Return the length of the edge's beginning outside of the image, as a share of the visible length."""
        hidden = float(self.along[0]) - max(_TIP_PX, _TIP_SHARE * self.length)
        return max(hidden, 0.0) / max(float(self.along[-1] - self.along[0]), 1.0)

    def moved(self, offset: float, slope: float) -> TracedEdge:
        pixels = self.pixels + (offset + slope * self.along)[:, None] * self.normals
        return TracedEdge(pixels, self.normals, self.along, self.length)


def trace_edge(curve: Curve, width: int, height: int) -> TracedEdge | Literal["outside", "few_pixels"]:
    """An edge in an image of this size, without its ends; or why there is none."""
    share = np.linspace(0.0, 1.0, 33)
    pixels = curve(share)
    if not np.all(np.isfinite(pixels[0])) or np.abs(pixels[0]).max() > 4.0 * (width + height):
        return "outside"
    good = np.flatnonzero(~np.isfinite(pixels).all(axis=1))
    if good.size:
        share, pixels = share[: good[0]], pixels[: good[0]]
    if len(pixels) < 3:
        return "outside"
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pixels, axis=0).T))])
    length = float(along[-1])
    first, last = max(_TIP_PX, _TIP_SHARE * length), (1.0 - _END_SHARE) * length
    if last - first < SHORTEST_PX:
        return "few_pixels"
    count = int(min(_MOST_PROFILES, last - first)) + 1
    places = np.linspace(first, last, count)
    at = np.column_stack([np.interp(places, along, pixels[:, axis]) for axis in range(2)])
    ahead = np.column_stack([np.interp(places + 1.0, along, pixels[:, axis]) for axis in range(2)])
    behind = np.column_stack([np.interp(places - 1.0, along, pixels[:, axis]) for axis in range(2)])
    tangent = ahead - behind
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    inside = np.all((at > 1.0) & (at < (width - 2.0, height - 2.0)), axis=1)
    if inside.sum() < SHORTEST_PX:
        return "outside"
    normals = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return TracedEdge(at[inside], normals[inside], places[inside], length)


@dataclass(frozen=True, eq=False)
class Crop:
    """A part of a frame in single precision, its first pixel, and its white noise by Immerkaer's operator (1996)."""

    image: NDArray[np.float32]
    first: Floats
    noise: float

    @classmethod
    def around(cls, image: Image, pixels: Floats) -> Crop:
        margin = WIDEST_PX + _CROP_PX
        low = np.maximum(np.floor(pixels.min(axis=0) - margin), 0.0).astype(int)
        high = np.ceil(pixels.max(axis=0) + margin).astype(int) + 1
        part = image[low[1] : high[1], low[0] : high[0]].astype(np.float32)
        laplacian = cv2.filter2D(part, -1, np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32))
        # The operator's norm is 6; the median, because edges answer it too.
        noise = float(np.median(np.abs(laplacian))) / 0.6745 / 6.0
        return cls(part, low.astype(np.float64), max(noise, 0.2))

    def sampled(self, places: Floats) -> Floats:
        """Grey levels (...) at pixels (..., 2); not a number outside."""
        at = (places - self.first).astype(np.float32)
        values = cv2.remap(
            self.image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
        )
        return np.asarray(values, np.float64)


def slopes_of(profiles: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Slopes (P, S) of profiles (P, S), levels a pixel, by the derivative of a Gaussian, and its taps; 0 outside."""
    reach = int(np.ceil(3.0 * sigma / STEP_PX))
    taps: Floats = STEP_PX * np.arange(-reach, reach + 1, dtype=np.float64)
    kernel: Floats = taps / sigma**2 * np.exp(-0.5 * (taps / sigma) ** 2)
    kernel /= np.sum(kernel * taps)  # a ramp of one level a pixel gives one
    filled = np.where(np.isfinite(profiles), profiles, 0.0).astype(np.float32)
    slope = cv2.filter2D(filled, cv2.CV_32F, kernel[None], borderType=cv2.BORDER_REPLICATE)
    return np.where(np.isfinite(profiles).all(axis=1, keepdims=True), slope, 0.0), kernel


def find_edges(profiles: Floats, across: Floats, wide: float, sigma: float, noise: float) -> ProfileEdges:
    """The strongest edges of each profile (P, S) of grey levels at offsets (S,)."""
    slope, kernel = slopes_of(profiles, sigma)
    size = np.abs(slope)
    peak = (size[:, 1:-1] >= size[:, :-2]) & (size[:, 1:-1] > size[:, 2:])
    # Neighbouring samples share pixels: the filter's noise is that of one sample for each pixel.
    floor = _NOISES * noise * float(np.sqrt(np.sum(kernel**2) / STEP_PX))
    peak &= (np.abs(across[1:-1]) <= wide) & (size[:, 1:-1] > floor)
    score = np.where(peak, size[:, 1:-1], 0.0)
    order = np.argsort(-score, axis=1)[:, :_CANDIDATES]
    rows = np.arange(len(score))[:, None]
    strength = score[rows, order]
    left, middle, right = (size[rows, order + k] for k in range(3))
    bend = left - 2.0 * middle + right
    shift = np.where(bend < 0.0, 0.5 * (left - right) / np.where(bend < 0.0, bend, -1.0), 0.0)
    offsets = across[1:-1][order] + STEP_PX * np.clip(shift, -0.5, 0.5)
    curvature = -bend / STEP_PX**2 / np.maximum(middle, 1e-9)
    share = np.sqrt(strength / np.maximum(strength[:, :1], 1e-9))
    return ProfileEdges(np.where(strength > 0.0, offsets, np.nan), share, curvature)
