"""The simulated walks that differ from the plain one by one thing that was chosen."""

from __future__ import annotations

from dataclasses import replace

from apexcal.documents.simulation import Disturbances
from benchmarks.detection.walks import FOUR_RINGS, SIZE, Case
from tests.support.scenes.flawed_lidar import Mount
from tests.support.scenes.held_board import BoardHold
from workers.simulation.sensors import SENSORS

_REFINED = {"refined": ("refined", SIZE)}
PLAIN = Case(
    "plain",
    {
        "strict": ("strict", {}),
        "tolerant": ("tolerant", {}),
        **_REFINED,
        "refined_size_unknown": ("refined", {}),
        "refined_without_track": ("refined", {**SIZE, "track": 0}),
    },
)
# What the other cases are compared with, on the same walks.
PLAIN_REFINED = replace(PLAIN, detectors=_REFINED)
_DISTRACTORS = (
    Case("head", _REFINED, Disturbances(head_above_m=0.1)),
    Case("second_person_beside", _REFINED, Disturbances(second_person="beside")),
    Case("second_person_behind", _REFINED, Disturbances(second_person="behind")),
    Case("pole", _REFINED, Disturbances(poles=6)),
)
_VARIANTS = (
    Case("range_noise_30mm", _REFINED, noise_m=0.030),
    Case("beam_3mrad", _REFINED, Disturbances(beam_mrad=3.0)),
    Case("four_rings", _REFINED, sensor=FOUR_RINGS),
    Case("lost_and_speckle", _REFINED, Disturbances(dropouts=0.02, speckle=0.002)),
)
_HELD = (
    *(Case(f"rolled_{deg:+.0f}", _REFINED, hold=BoardHold(rolled_deg=deg)) for deg in (-15.0, -10.0, 10.0, 15.0)),
    *(Case(f"tilted_{deg:.0f}", _REFINED, hold=BoardHold(tilted_deg=deg)) for deg in (8.0, 18.0)),
    *(Case(f"torso_{m * 100:.0f}cm", _REFINED, hold=BoardHold(body_behind_m=m)) for m in (0.25, 0.45, 0.9)),
    Case("rolled_tilted", _REFINED, hold=BoardHold(rolled_deg=12.0, tilted_deg=10.0, body_behind_m=0.3)),
)
_FAST = replace(SENSORS["vlp16"], rate_hz=20.0, step_deg=0.4)
_SPINNING = (
    Case("seam_ahead", _REFINED, mount=Mount(seam_deg=0.0)),
    Case("upside_down", _REFINED, mount=Mount(roll_deg=180.0)),
    Case("mount_rolled_20", _REFINED, mount=Mount(roll_deg=20.0)),
    Case("mixed_steps", _REFINED, sensor=SENSORS["mixed128"]),
    Case("20_hz", _REFINED, sensor=_FAST),
)
GROUPS = {"distractors": _DISTRACTORS, "variants": _VARIANTS, "held": _HELD, "spinning": _SPINNING}
