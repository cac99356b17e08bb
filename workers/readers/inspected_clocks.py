"""Reports on the clocks of a recording's sensors, from a few messages, or from all if a clock seems to step."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.normalised.clocks import CLOCKS_APART_NS, ClockReport, Times, offset_reports, report_clocks
from workers.readers.recording import Recording, Sensor

# Of each sensor, to compare its stamps with the times of recording.
_SAMPLES: Final = 9


def sensor_clocks(
    recording: Recording, chosen: Mapping[str, Sensor], logs: Mapping[str, NDArray[np.int64]]
) -> tuple[dict[str, NDArray[np.int64]], dict[str, float], dict[str, ClockReport]]:
    """Look at the clocks of sensors, the LiDAR first.

    Args:
        logs: (N,) times of recording of each sensor's messages, ns.

    Returns:
        The messages' times, which are their stamps by one clock where a clock steps; how long they were underway,
        seconds; and what the clocks did.
    """
    samples: dict[str, Times] = {}
    for name, sensor in chosen.items():
        pairs = np.array(list(recording.log_and_stamp(sensor, _SAMPLES)), np.int64).reshape(-1, 2)
        if len(pairs):
            samples[name] = Times(pairs[:, 0], pairs[:, 1], pairs[:, 0])
    delays = {name: float(np.median(each.log - each.stamp)) / 1e9 for name, each in samples.items()}
    if len(samples) < len(chosen):
        return dict(logs), delays, {}
    if all(np.ptp(each.log - each.stamp) < CLOCKS_APART_NS for each in samples.values()):
        return dict(logs), delays, offset_reports(samples)
    messages = _all_times(recording, chosen)
    clocks = report_clocks(messages)
    times = {name: messages[name].stamp + clock.added_ns - clock.offset_ns for name, clock in clocks.items()}
    return times, delays, clocks


def _all_times(recording: Recording, chosen: Mapping[str, Sensor]) -> dict[str, Times]:
    """Stamps and times of recording of all messages of some sensors, by their names."""
    columns = {sensor.name: (array("q"), array("q"), array("q")) for sensor in chosen.values()}
    for number, (sensor, stamp_ns, log_ns) in enumerate(recording.stamps(list(chosen.values()))):
        for column, value in zip(columns[sensor.name], (number, stamp_ns, log_ns), strict=True):
            column.append(value)
    arrays = {name: [np.array(column, np.int64) for column in each] for name, each in columns.items()}
    return {name: Times(*arrays[sensor.name]) for name, sensor in chosen.items()}
