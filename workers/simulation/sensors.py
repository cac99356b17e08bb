"""The spinning LiDARs that can be simulated: elevations of their rings, azimuths of their lasers, rates.

Figures are those of the makers' manuals; a real sensor's calibration differs by some hundredths of a degree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, slots=True)
class LidarModel:
    """A spinning sensor.

    Attributes:
        elevations_deg: of each ring, rising.
        step_deg: azimuth between two firings of one laser.
        rate_hz: turns per second.
        max_range_m: farther surfaces give no point.
        lens_m: how far before the axis the beams cross: a ring of elevation e leaves the axis at -lens_m tan(e). What
            drivers make of packets has this in it; 0: all beams leave the origin.
        azimuths_deg: how far to the left of the column each ring's laser points; empty where all point along it.
    """

    name: str
    elevations_deg: tuple[float, ...]
    step_deg: float = 0.2
    rate_hz: float = 10.0
    max_range_m: float = 100.0
    lens_m: float = 0.0
    azimuths_deg: tuple[float, ...] = ()


def _even(name: str, rings: int, lowest: float, highest: float) -> LidarModel:
    return LidarModel(name, tuple(np.linspace(lowest, highest, rings).tolist()))


def _ouster(name: str, rings: int, half_span_deg: float, columns: int) -> LidarModel:
    """Rings in groups of four, staggered in azimuth: gen-1 sensors carry four columns of emitters."""
    even = _even(name, rings, -half_span_deg, half_span_deg)
    stagger = tuple((-3.164, -1.055, 1.055, 3.164)[ring % 4] for ring in range(rings))
    return replace(even, step_deg=360.0 / columns, max_range_m=120.0, azimuths_deg=stagger)


# fmt: off
_VLP32C = (  # elevation, azimuth to the left
    (-25.0, 1.4), (-15.639, -1.4), (-11.31, 1.4), (-8.843, -1.4), (-7.254, 1.4), (-6.148, -1.4), (-5.333, 4.2),
    (-4.667, 1.4), (-4.0, -1.4), (-3.667, -4.2), (-3.333, 4.2), (-3.0, 1.4), (-2.667, -1.4), (-2.333, -4.2),
    (-2.0, 4.2), (-1.667, 1.4), (-1.333, -1.4), (-1.0, -4.2), (-0.667, 4.2), (-0.333, 1.4), (0.0, -1.4),
    (0.333, -4.2), (0.667, 4.2), (1.0, 1.4), (1.333, -1.4), (1.667, -4.2), (2.333, 1.4), (3.333, -1.4),
    (4.667, 1.4), (7.0, -1.4), (10.333, 1.4), (15.0, -1.4),
)
# Dense in the middle, 0.11 degrees from ring to ring, and wide outside of it.
_ALPHA_PRIME_LOW = (-25.0, -19.582, -16.042, -13.565, -11.742, -10.346, -9.244, -8.352, -7.65, -7.15, -6.85, -6.65)
_ALPHA_PRIME_HIGH = (4.98, 5.18, 5.43, 5.73, 6.08, 6.48, 6.98, 7.58, 8.43, 9.7, 11.75, 15.0)
_ALPHA_PRIME_STAGGER = (-0.911, -2.732, -4.548, -6.354, 6.354, 4.548, 2.732, 0.911)
# fmt: on


def _alpha_prime() -> LidarModel:
    middle = tuple(round(-6.5 + 0.11 * ring, 2) for ring in range(104))
    stagger = tuple(_ALPHA_PRIME_STAGGER[ring % 8] for ring in range(128))
    elevations = (*_ALPHA_PRIME_LOW, *middle, *_ALPHA_PRIME_HIGH)
    return LidarModel("alpha-prime", elevations, max_range_m=200.0, azimuths_deg=stagger)


def _hdl64() -> LidarModel:
    """Two blocks of 32 lasers: half a degree apart below, a third of a degree above."""
    elevations = (*np.linspace(-24.33, -8.83, 32), *np.linspace(-8.33, 2.0, 32))
    return LidarModel("hdl64", tuple(float(value) for value in elevations), max_range_m=120.0)


# Of a VLP-16: the "vertical correction" of its manual, 11.2 mm at -15 degrees.
VLP16_LENS_M = 0.0419

SENSORS = {
    "vlp16": _even("vlp16", 16, -15.0, 15.0),
    "puck-hi-res": _even("puck-hi-res", 16, -10.0, 10.0),
    "vlp32c": LidarModel(
        "vlp32c", tuple(e for e, _ in _VLP32C), max_range_m=200.0, azimuths_deg=tuple(a for _, a in _VLP32C)
    ),
    "hdl32": _even("hdl32", 32, -30.67, 10.67),
    "hdl64": _hdl64(),
    "alpha-prime": _alpha_prime(),
    "os1-32": _ouster("os1-32", 32, 22.5, 1024),
    "os1-64": _ouster("os1-64", 64, 22.5, 2048),
    "os1-128": _ouster("os1-128", 128, 22.5, 2048),
    "lux4": replace(_even("lux4", 4, -1.2, 1.2), step_deg=0.25, rate_hz=12.5),
}


def with_rings(sensor: LidarModel, rings: int) -> LidarModel:
    """The sensor with another number of rings, spread evenly over its elevations."""
    lowest, highest = sensor.elevations_deg[0], sensor.elevations_deg[-1]
    return replace(sensor, elevations_deg=_even(sensor.name, rings, lowest, highest).elevations_deg, azimuths_deg=())
