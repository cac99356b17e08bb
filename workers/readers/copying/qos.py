"""Quality-of-service profiles as rosbag2 stores them, for topics that are added (rmw_qos_profile_t)."""

from __future__ import annotations

from typing import Final

_ENDLESS: Final = "{sec: 9223372036, nsec: 854775807}"


def _profile(durability: int) -> str:
    # history: keep last; reliability: reliable; liveliness: automatic.
    lines = (
        "- history: 1",
        "depth: 1",
        "reliability: 1",
        f"durability: {durability}",
        f"deadline: {_ENDLESS}",
        f"lifespan: {_ENDLESS}",
        "liveliness: 1",
        f"liveliness_lease_duration: {_ENDLESS}",
        "avoid_ros_namespace_conventions: false",
    )
    return "\n  ".join(lines)


LATCHED_QOS: Final = _profile(1)  # transient local
SENSOR_QOS: Final = _profile(2)  # volatile
