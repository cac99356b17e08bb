"""What each ring measures too much, and planes through rings that share an error."""

import numpy as np
import pytest

from workers.vertices.refined.planes import fit_plane
from workers.vertices.refined.ring_errors import RingMeans, ring_errors

_NOISE, _SPREAD = 0.007, 0.012
_ANY = np.array([0.0, 0.6, 0.0, 0.25])


def _rays(low, high):
    ring = np.repeat(np.arange(low, high), 30)
    azimuth = np.tile(np.linspace(-0.1, 0.1, 30), high - low)
    return ring, azimuth, -0.15 + 0.02 * ring


def _board(random, low, error):
    """Points of a plane 4 to 6 m away that leans as people lean a board, on eight rings."""
    ring, azimuth, slope = _rays(low, low + 8)
    w = np.array([1.0, random.normal(0.0, 0.2), random.normal(-0.08, 0.04)]) / random.uniform(4.0, 6.0)
    plane = 1.0 / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)
    return ring, azimuth, slope, plane + random.normal(0.0, _NOISE, ring.size) + error[ring], w


def _means(ring, azimuth, slope, distance, w):
    rows, of = np.unique(ring, return_inverse=True)
    count = np.bincount(of).astype(float)
    rays = np.array([np.bincount(of, part) for part in (np.cos(azimuth), np.sin(azimuth), slope)]).T / count[:, None]
    beyond = distance - 1.0 / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)
    return RingMeans(rows, rays, 1.0 / (rays @ w), np.bincount(of, beyond) / count, count, w)


def test_errors_of_rings_are_told_by_boards_at_different_heights():
    random = np.random.default_rng(3)
    error = random.normal(0.0, _SPREAD, 16)
    boards = []
    for low in [0, 2, 4, 6, 7] * 4:
        ring, azimuth, slope, distance, _ = _board(random, low, error)
        sigma = float(np.hypot(_NOISE, _SPREAD))
        w, _ = fit_plane(azimuth, slope, distance, ring, np.ones(ring.size), sigma, _SPREAD, _ANY)
        boards.append(_means(ring, azimuth, slope, distance, w))
    told, variance = ring_errors(boards, 20, _NOISE, _SPREAD, tuple(_ANY))
    assert (told[15:] == 0.0).all()  # no board was there
    assert np.sqrt(variance[15:]) == pytest.approx(_SPREAD)
    off = told[:15] - error[:15]
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.sqrt(np.mean(error[:15] ** 2))
    assert np.sqrt(np.mean(off**2)) < 2.0 * np.sqrt(np.mean(variance[:15]))


def test_the_spread_of_a_plane_holds_the_errors_of_its_rings():
    random = np.random.default_rng(4)
    slopes, stated = [], []
    for _ in range(200):
        ring, azimuth, slope, distance, true = _board(random, 4, random.normal(0.0, _SPREAD, 16))
        sigma = float(np.hypot(_NOISE, _SPREAD))
        w, info = fit_plane(azimuth, slope, distance, ring, np.ones(ring.size), sigma, _SPREAD, _ANY)
        towards = np.column_stack([w[1:] / w[0] ** 2, -np.eye(2) / w[0]])
        slopes.append(true[1:] / true[0] - w[1:] / w[0])
        stated.append(np.sqrt(np.diag(towards @ np.linalg.inv(info) @ towards.T)))
    wrong = np.array(slopes) / np.array(stated)
    assert np.sqrt(np.mean(wrong**2, axis=0)) == pytest.approx([1.0, 1.0], abs=0.2)
