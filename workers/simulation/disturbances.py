"""What a real recording has and a clean simulation lacks. All of it is off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SecondPerson = Literal["none", "beside", "behind"]
SECOND_PERSON: tuple[SecondPerson, ...] = ("none", "beside", "behind")


@dataclass(frozen=True, slots=True)
class Disturbances:
    """What makes the board harder to see; the defaults change nothing.

    Attributes:
        beam_mrad: full width of a laser beam, milliradians (a VLP-16 has about 3). A beam that touches a nearer
            surface with its rim returns from there, so that every edge grows by half a beam.
        dropout_share: share of returns that are lost, at random.
        speckle_share: share of beams that meet rain, snow or dust close by instead.
        walker_height_m: of the person who carries the board; a taller one lifts it higher.
        head_above_m: 0: the walker ducks behind the board. Else the board is held so low that the head's top is at
            least this much above the apex.
        second_person: another person who goes along, ``beside`` or ``behind`` the walker.
        poles: how many poles stand inside the region where the walker walks.
        rolled_deg: how far the board is rolled on average, counter-clockwise as the LiDAR sees it.
        tilted_deg: how far the board leans on average, the upper end away from the LiDAR, beyond the usual 2 degrees.
        body_behind_m: from the board to the axis of the torso.
        torso_m: radius of the torso with what is worn.
        hand_m: radius of the hands and sleeves at the board's lower edges; 0: they are behind it.

    Raises:
        ValueError: a value that cannot be simulated, said in one sentence.
    """

    beam_mrad: float = 0.0
    dropout_share: float = 0.0
    speckle_share: float = 0.0
    walker_height_m: float = 1.74
    head_above_m: float = 0.0
    second_person: SecondPerson = "none"
    poles: int = 0
    rolled_deg: float = 0.0
    tilted_deg: float = 0.0
    body_behind_m: float = 0.22
    torso_m: float = 0.15
    hand_m: float = 0.0

    def __post_init__(self) -> None:
        limits = {
            "beam_mrad": (0.0, 20.0),
            "dropout_share": (0.0, 0.9),
            "speckle_share": (0.0, 0.5),
            "walker_height_m": (1.4, 2.1),
            "head_above_m": (0.0, 0.3),
            "poles": (0, 20),
            "rolled_deg": (-30.0, 30.0),
            "tilted_deg": (-30.0, 30.0),
            "body_behind_m": (self.torso_m + 0.01, 1.5),
            "torso_m": (0.1, 0.35),
            "hand_m": (0.0, 0.15),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} must lie between {low:g} and {high:g}, not {value:g}")
        if self.second_person not in SECOND_PERSON:
            raise ValueError(f"second_person is one of {', '.join(SECOND_PERSON)}, not {self.second_person!r}")
