"""A sweep's board as the sweeps before and after see it: its likely roll, and whether its apex lies on a smooth path.

Neighbours never move an apex, so the errors of neighbouring sweeps stay nearly independent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workers.vertices.board.board_estimate import BoardEstimate
from workers.vertices.board.model import BoardModel, Floats
from workers.vertices.sweep_source import SweepSource, stamp_of

_REACH, _MOST_REACH, _REACH_S = 10, 30, 1.0  # sweeps to either side; more if the sensor turns faster
LONGEST_S = 1.5
FASTEST_M_S = 3.0
TREMBLE_M = 0.2
_ROLL_LENGTH_S = 0.45  # how long a held board keeps its roll
_ROLL_FLOOR = math.radians(0.6)
_ROLL_INFLATION = 1.5  # posteriors of single sweeps are no Gaussians, and their errors correlate a little
_FEWEST = 4
_SWAY_M = 0.03
_SHOULDERS_M = 0.5  # breadth of a standing person (DIN 33402-2): two people stand farther apart


@dataclass(frozen=True, slots=True, eq=False)
class TimedEstimate:
    """The board of one sweep by itself, and when its apex was measured."""

    time_ns: int
    board: BoardEstimate


def neighbour_count(source: SweepSource) -> int:
    """Return how many sweeps to either side help."""
    count = len(source)
    if count < 2:
        return _REACH
    period_s = (stamp_of(source, count - 1) - stamp_of(source, 0)) * 1e-9 / (count - 1)
    return max(_REACH, min(round(_REACH_S / period_s), _MOST_REACH)) if period_s > 0.0 else _REACH


def roll_prior(own: TimedEstimate, others: Sequence[TimedEstimate], model: BoardModel) -> tuple[float, float]:
    """Return mean and standard deviation of the roll, by the neighbours that a walker may have come from or gone to.

    Gaussian-process regression; each neighbour's roll counts as its posterior without the prior.
    """
    mean, spread = model.roll
    after = np.array([other.time_ns - own.time_ns for other in others], np.float64) * 1e-9
    apart = np.array([np.linalg.norm(other.board.xyz - own.board.xyz) for other in others])
    roll = np.array([other.board.hold.roll for other in others])
    precision = np.array([other.board.hold.roll_sigma for other in others]) ** -2.0 - spread**-2.0
    counted = (apart < TREMBLE_M + FASTEST_M_S * np.abs(after)) & (precision > 0.1 * spread**-2.0)
    # A sweep that was recorded twice adds nothing.
    counted &= (np.abs(after) < LONGEST_S) & (after != 0.0)
    if not counted.any():
        return mean, spread
    after, once = np.unique(after[counted], return_index=True)
    roll, precision = roll[counted][once], precision[counted][once]
    alone = (roll - mean) * (precision + spread**-2.0) / precision
    between = spread**2 * np.exp(-0.5 * ((after[:, None] - after[None, :]) / _ROLL_LENGTH_S) ** 2)
    towards = spread**2 * np.exp(-0.5 * (after / _ROLL_LENGTH_S) ** 2)
    gain = np.linalg.solve(between + np.diag(_ROLL_INFLATION / precision), towards)
    variance = spread**2 - float(gain @ towards)
    return mean + float(gain @ alone), min(math.sqrt(max(variance, 0.0) + _ROLL_FLOOR**2), spread)


def path_deviation(own: TimedEstimate, others: Sequence[TimedEstimate]) -> float | None:
    """Return the standard deviations by which the apex lies off a smooth path of its neighbours; None: no path."""
    near = [other for other in others if abs(other.time_ns - own.time_ns) < LONGEST_S * 1e9]
    if len(near) < _FEWEST:
        return None
    x, y, z = own.board.xyz.tolist()
    flat, reach = math.hypot(x, y), math.sqrt(x * x + y * y + z * z)
    axes = np.array([[-y / flat, x / flat, 0.0], [-x * z / flat / reach, -y * z / flat / reach, flat / reach]])
    after = np.array([other.time_ns - own.time_ns for other in near], np.float64) * 1e-9
    offset = np.array([axes @ (other.board.xyz - own.board.xyz) for other in near])
    sigma = reach * np.array([[other.board.sigma_azimuth, other.board.sigma_elevation] for other in near])
    own_sigma = reach * np.array([own.board.sigma_azimuth, own.board.sigma_elevation])
    powers = np.vander(after, 3 if len(near) >= 2 * _FEWEST else 2, increasing=True)
    return max(
        _deviation_at_zero(powers, offset[:, k], np.hypot(sigma[:, k], _SWAY_M), float(own_sigma[k])) for k in (0, 1)
    )


def is_confirmed(own: TimedEstimate, others: Sequence[TimedEstimate]) -> bool:
    """Return whether a neighbour shows a board so near that nobody else can stand there."""
    return any(
        abs(other.time_ns - own.time_ns) < LONGEST_S * 1e9
        and float(np.linalg.norm(other.board.xyz - own.board.xyz)) < _SHOULDERS_M
        for other in others
    )


def _deviation_at_zero(powers: Floats, value: Floats, sigma: Floats, own_sigma: float) -> float:
    """Return the standard deviations from 0, the apex itself, of a robust polynomial (Cauchy weights) at time 0."""
    middle = float(np.median(value))
    doubt = (1.0 + ((value - middle) / (5.0 * sigma)) ** 2) ** -1.0
    inverse = np.eye(powers.shape[1])
    at_zero = middle
    scale = 1.0
    for _ in range(6):
        weight = doubt / sigma**2
        inverse = np.linalg.inv((powers.T * weight) @ powers + 1e-6 * np.eye(powers.shape[1]))
        solution = inverse @ (powers.T @ (weight * value))
        at_zero = float(solution[0])
        scaled = (value - powers @ solution) / sigma
        scale = max(1.4826 * float(np.median(np.abs(scaled))), 1.0)
        doubt = (1.0 + (scaled / (2.5 * scale)) ** 2) ** -1.0
    error = math.sqrt(own_sigma**2 + _SWAY_M**2 + scale**2 * float(inverse[0, 0]) + (scale - 1.0) ** 2 * 0.01)
    return abs(at_zero) / error
