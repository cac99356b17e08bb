"""The spinning LiDARs that can be simulated: elevations of their rings, azimuths of their lasers, rates.

Figures are those of the makers' manuals; a real sensor's calibration differs by some hundredths of a degree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from apexcal.documents.simulation import SensorName


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
        every: in how many columns each ring's laser fires once; empty where all fire in each.
    """

    name: str
    elevations_deg: tuple[float, ...]
    step_deg: float = 0.2
    rate_hz: float = 10.0
    max_range_m: float = 100.0
    lens_m: float = 0.0
    azimuths_deg: tuple[float, ...] = ()
    every: tuple[int, ...] = ()


def _even(name: str, rings: int, lowest: float, highest: float) -> LidarModel:
    return LidarModel(name, tuple(np.linspace(lowest, highest, rings).tolist()))


_OS1_STAGGER = (-3.164, -1.055, 1.055, 3.164)
_OS0_STAGGER = (-10.3, -3.2, 3.9, 11.2)  # as the metadata of one say


def _ouster(
    name: str, rings: int, half_span_deg: float, columns: int, stagger: tuple[float, ...], max_range_m: float = 120.0
) -> LidarModel:
    """Rings in groups, staggered in azimuth: the sensors carry several columns of emitters."""
    even = _even(name, rings, -half_span_deg, half_span_deg)
    aside = tuple(stagger[ring % len(stagger)] for ring in range(rings))
    return replace(even, step_deg=360.0 / columns, max_range_m=max_range_m, azimuths_deg=aside)


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


def _pandar40p() -> LidarModel:
    """A third of a degree apart from -6 to 2 degrees, wider outside of it."""
    middle = tuple(round(-6.0 + ring / 3.0, 3) for ring in range(25))
    elevations = (-25.0, -19.0, *range(-14, -6), *middle, 3.0, 5.0, 8.0, 11.0, 15.0)
    stagger = tuple((-1.042, 3.125, -5.208)[(ring - 10) % 3] if 10 < ring < 34 else -1.042 for ring in range(40))
    return LidarModel("pandar40p", elevations, max_range_m=200.0, azimuths_deg=stagger)


def _qt64() -> LidarModel:
    """Two halves that mirror each other, wider apart towards the poles; 20 m on dark surfaces."""
    upper = (
        *(0.725, 2.175, 3.626, 5.079, 6.534, 7.993, 9.456, 10.923, 12.397, 13.877, 15.365, 16.861, 18.368, 19.885),
        *(21.415, 22.959, 24.524, 26.101, 27.697, 29.315, 30.957, 32.627, 34.328, 36.064, 37.840, 39.662, 41.537),
        *(43.475, 45.487, 47.587, 49.795, 52.133),
    )
    aside = (*[-6.4] * 16, *[5.0] * 16, *[-5.6] * 16, *[5.0] * 16)
    elevations = (*(-e for e in reversed(upper)), *upper)
    return LidarModel("qt64", elevations, step_deg=0.6, max_range_m=50.0, azimuths_deg=aside)


def _mixed128() -> LidarModel:
    """As a Pandar128: 64 rings in the middle fire every 0.1 degrees, those above and below half as often."""
    middle = tuple(round(-6.0 + 0.125 * ring, 3) for ring in range(64))
    elevations = (*np.linspace(-25.0, -6.4, 32).tolist(), *middle, *np.linspace(2.4, 15.0, 32).tolist())
    every = (*[2] * 32, *[1] * 64, *[2] * 32)
    return LidarModel("mixed128", elevations, step_deg=0.1, max_range_m=200.0, every=every)


def _hdl64() -> LidarModel:
    """Two blocks of 32 lasers: half a degree apart below, a third of a degree above."""
    elevations = (*np.linspace(-24.33, -8.83, 32), *np.linspace(-8.33, 2.0, 32))
    return LidarModel("hdl64", tuple(float(value) for value in elevations), max_range_m=120.0)


SENSORS: dict[SensorName, LidarModel] = {
    "vlp16": _even("vlp16", 16, -15.0, 15.0),
    "puck-hi-res": _even("puck-hi-res", 16, -10.0, 10.0),
    "vlp32c": LidarModel(
        "vlp32c", tuple(e for e, _ in _VLP32C), max_range_m=200.0, azimuths_deg=tuple(a for _, a in _VLP32C)
    ),
    "hdl32": _even("hdl32", 32, -30.67, 10.67),
    "hdl64": _hdl64(),
    "alpha-prime": _alpha_prime(),
    "os0-128": _ouster("os0-128", 128, 45.0, 1024, _OS0_STAGGER, 50.0),
    "os1-32": _ouster("os1-32", 32, 22.5, 1024, _OS1_STAGGER),
    "os1-64": _ouster("os1-64", 64, 22.5, 2048, _OS1_STAGGER),
    "os1-128": _ouster("os1-128", 128, 22.5, 2048, _OS1_STAGGER),
    "os2-128": _ouster("os2-128", 128, 11.25, 2048, (-2.07, 2.07), 240.0),
    "xt32": replace(_even("xt32", 32, -16.0, 15.0), step_deg=0.18, max_range_m=120.0),
    "qt64": _qt64(),
    "pandar40p": _pandar40p(),
    "mixed128": _mixed128(),
    "lux4": replace(_even("lux4", 4, -1.2, 1.2), step_deg=0.25, rate_hz=12.5),
}


def with_rings(sensor: LidarModel, rings: int) -> LidarModel:
    """The sensor with another number of rings, spread evenly over its elevations."""
    lowest, highest = sensor.elevations_deg[0], sensor.elevations_deg[-1]
    return replace(sensor, elevations_deg=_even(sensor.name, rings, lowest, highest).elevations_deg, azimuths_deg=())
