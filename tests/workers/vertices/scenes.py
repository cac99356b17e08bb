"""The scenes on which promises of the refined detector are tested, one row each: what is there, and what is promised.

A new way to hold a board, or a new thing that is none, is a row here; `test_promises.py` goes through all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from benchmarks.detection.walks import Walked, looked_at, simulate
from tests.support.scenes.drawn import draw_street
from tests.support.scenes.flawed_lidar import FlawedLidar
from tests.support.scenes.held_board import BoardHold, HeldWalk
from tests.workers.vertices.refined_walks import REGION, SIZE, START_NS, Recorded, walk
from tests.workers.vertices.test_facades import street
from workers.readers.recording import Sweep
from workers.simulation.scene import scene_with
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import BOARD_EDGES_M, TORSO_RADIUS_M, Poses
from workers.vertices.region import Region

_PERIOD_S = 6.0


class Seen(NamedTuple):
    """Sweeps, where the apex was in each (S, 3), and whether the board is to be found in it (S,)."""

    sweeps: Sequence[Sweep]
    apex: np.ndarray
    is_there: np.ndarray
    region: Region = REGION
    options: dict[str, float] = SIZE
    may_be: np.ndarray | None = None  # whether a vertex of it is right, (S,); of each where it is not stated
    first: int | None = None  # so many sweeps are looked at; all of them are there to learn from


@dataclass(frozen=True)
class Scene:
    """What is seen, and what is promised of it.

    Attributes:
        least: more than this share of the sweeps in which the board is to be found give a vertex.
        fewest: how many do.
        elsewhere: how many vertices there may be where none is right.
        worst_m, worst_deg: how far any vertex may be off; across the ray in degrees.
        gross: the share that may be off by more than 0.3 degrees.
        within: the share of errors within two stated deviations.
        flagged: a flag, and the share of vertices that must bear it.
        roll_deg: the mean roll.
        refused: no vertex; the sweeps that say this reason, at least.
    """

    make: Callable[[], Seen]
    least: float = 0.0
    fewest: int = 1
    elsewhere: int = 0
    worst_m: float = np.inf
    worst_deg: float = np.inf
    mean_deg: float = np.inf
    gross: float = 1.0
    within: float = 0.0
    flagged: tuple[str, float] = ("", 0.0)
    roll_deg: float | None = None
    refused: tuple[str, int] | None = None
    slow: bool = False


def of_walk(recorded: Recorded) -> Seen:
    return Seen(recorded.sweeps, recorded.apex, recorded.rings >= 2)


def walked(*args, **kwargs) -> Callable[[], Seen]:
    return lambda: of_walk(walk(*args, **kwargs))


def poses(count: int, seed: int = 27, biased_m: float = 0.0) -> Recorded:
    """Sweeps of a walk far apart, as stamps of ten a second would have them; each ring with a bias of its own."""
    recorded = walk(seed, 30.0)
    near = np.argsort(np.linalg.norm(recorded.apex, axis=1))[:: len(recorded.sweeps) // (3 * count)][:count]
    chosen = np.random.default_rng(seed).permutation(near)
    bias = np.random.default_rng(seed).normal(0.0, biased_m, 64)
    sweeps = []
    for number, index in enumerate(chosen):
        sweep = recorded.sweeps[index]
        reach = np.linalg.norm(sweep.xyz, axis=1)
        xyz = sweep.xyz * (1.0 + bias[sweep.ring] / reach)[:, None]
        sweeps.append(replace(sweep, xyz=xyz.astype(np.float32), stamp_ns=START_NS + 100_000_000 * number))
    return Recorded(sweeps, recorded.apex[chosen], recorded.moment_ns[chosen], recorded.rings[chosen])


class Resting:
    """A walk in which the board is lowered for a share of each six seconds: beside the legs, its edges upright."""

    def __init__(self, walk: HeldWalk, share: float, ground_z: float) -> None:
        self.walk, self.share, self.ground_z = walk, share, ground_z

    def rests(self, time_s: np.ndarray) -> np.ndarray:
        return np.asarray(time_s) % _PERIOD_S < self.share * _PERIOD_S

    def poses(self, time_s: np.ndarray) -> Poses:
        raised = self.walk.poses(time_s)
        rests = self.rests(time_s)[:, None]
        left = np.column_stack([raised.left, np.zeros(len(raised.left))])
        up = np.array([0.0, 0.0, 1.0])
        beside = raised.body - 0.22 * np.cross(left, up)[:, :2] + 0.25 * raised.left
        corner = np.column_stack([beside, np.full(len(left), self.ground_z + 1.0)])
        return replace(
            raised,
            apex=np.where(rests, corner, raised.apex),
            edge_left=np.where(rests, left, raised.edge_left),
            edge_right=np.where(rests, -up, raised.edge_right),
            height=np.where(rests[:, 0], 1.74, raised.height),
        )


def resting(seed, seconds, *, share=0.0, plan="field", board_m=BOARD_EDGES_M, hold=None) -> Callable[[], Seen]:
    """A VLP-16 before somebody who lowers the board."""

    def make() -> Seen:
        scene = scene_with(0, seed)
        held = HeldWalk(seed, seconds, scene.ground_z, plan=plan, board_m=board_m, hold=hold)
        way = Resting(held, share, scene.ground_z)
        lidar = FlawedLidar(SENSORS["vlp16"], scene, way, sector_deg=60.0, noise_m=0.008, seed=seed)
        made = looked_at(way, lidar, seconds)
        raised = ~way.rests(0.1 * np.arange(len(made.sweeps)) + 0.05)
        size = {"board_width_m": board_m[0], "board_height_m": board_m[1]}
        return Seen(made.sweeps, made.apexes, raised & (made.rings >= 2), options=size, may_be=raised)

    return make


def on_three_rings() -> Seen:
    """The sweeps of a walk in which no more than three rings meet the board."""
    seen = walk(27, 30.0)
    far = np.flatnonzero((seen.rings == 2) | (seen.rings == 3))
    return Seen([seen.sweeps[k] for k in far], seen.apex[far], np.ones(len(far), bool))


def near_sweeps() -> Seen:
    """Eight sweeps about the nearest one."""
    seen = walk(27, 8.0)
    first = int(np.argmin(np.linalg.norm(seen.apex[:70], axis=1)))
    return Seen(seen.sweeps[first : first + 8], seen.apex[first : first + 8], np.ones(8, bool))


def half_bodies() -> Seen:
    """A walk on two rings: of 24 near planes 11 are boards; the others go on into the body."""
    seen: Walked = simulate(9314, 60.0)
    return Seen(seen.sweeps, seen.apexes, seen.rings >= 2, first=150)


def of_a_street(seed: int, *, is_known: bool = True) -> Callable[[], Seen]:
    """Five sweeps of a street without a board."""

    def make() -> Seen:
        drawn = draw_street(seed)
        _, lidar = drawn.simulated(1.0)
        rate = lidar.sensor.rate_hz
        sweeps = [lidar.sweep(k, k / rate, round(k / rate * 1e9)) for k in range(5)]
        size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]} if is_known else {}
        return nothing(sweeps, Region.from_document(drawn.region()), size)

    return make


def nothing(sweeps: Sequence[Sweep], region: Region, options: dict[str, float]) -> Seen:
    return Seen(sweeps, np.zeros((len(sweeps), 3)), np.zeros(len(sweeps), bool), region=region, options=options)


@cache
def with_arms_forward() -> list[Sweep]:
    """Somebody who walks with both arms stretched forward; three rings meet them as they meet a board."""

    def boxes(x: float, y: float) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
        trunk = (x - 0.12, y - 0.15, -1.0), (x + 0.12, y + 0.2, -0.4)
        arms = (x - 0.12, y - 0.3, -0.42), (x + 0.1, y + 0.3, -0.1)
        legs = (
            ((x - 0.1, y + 0.02, -1.8), (x + 0.1, y + 0.15, -1.0)),
            ((x + 0.25, y - 0.15, -1.8), (x + 0.4, y - 0.05, -1.0)),
        )
        head = (x, y - 0.1, -0.1), (x + 0.2, y + 0.1, 0.1)
        return [trunk, arms, *legs, head]

    random = np.random.default_rng(2)
    return [street(k, boxes(15.0 + 0.02 * k, -2.0 + 0.06 * k), random) for k in range(70)]


def arms_forward(edges: tuple[float, float]) -> Callable[[], Seen]:
    region = Region.from_document({"all": [{"box": {"min": [10.0, -6.0, -1.5], "max": [22.0, 6.0, 1.5]}}]})
    return lambda: nothing(with_arms_forward(), region, {"board_width_m": edges[0], "board_height_m": edges[1]})


_HEAD, _PEOPLE = Disturbances(head_above_m=0.12), Disturbances(poles=5, second_person="beside")
_TORSO = BoardHold(body_behind_m=TORSO_RADIUS_M + 0.05, tilted_deg=-8.0)

SCENES = {
    "a head above the board": Scene(
        walked(13, 8.0, disturbances=_HEAD), fewest=17, gross=0.03, flagged=("head_above", 0.3)
    ),
    "poles and a second person": Scene(walked(14, 8.0, disturbances=_PEOPLE), 0.4, gross=0.03),
    # Below the board its plane runs through a torso 5 cm behind it. Before, 6 of 50 sweeps gave a vertex.
    "a torso behind a leaning board": Scene(walked(21, 5.0, plan="yard", hold=_TORSO), 0.85, worst_m=0.05),
    **{
        f"{count} poses, rings off by {biased_m} m": Scene(
            lambda count=count, biased_m=biased_m: of_walk(poses(count, biased_m=biased_m)),
            0.85,
            worst_deg=0.3,
            within=0.85,
        )
        for count, biased_m in ((16, 0.012), (8, 0.012), (1, 0.0))
    },
    **{
        f"rolled by {roll}": Scene(
            walked(27, 8.0, hold=BoardHold(rolled_deg=roll)),
            0.75,
            mean_deg=0.032,  # walks of 30 s are off by 0.0164 degrees at most (`make bench-detection`)
            within=0.93,
            roll_deg=roll,
            slow=slow,
        )
        for roll, slow in ((15.0, False), (-15.0, True), (10.0, True))
    },
    # Before, 31 and 32 of 77 and 60 sweeps of the raised board gave a vertex: the others said `never_shown`.
    "lowered in the field": Scene(resting(27, 12.0, share=0.6), 0.9, elsewhere=1, worst_m=0.3, slow=True),
    "lowered in a yard": Scene(resting(1, 12.0, share=0.75, plan="yard"), 0.9, elsewhere=1, worst_m=0.3),
    # Before, 3 and 4 of these sweeps gave a vertex.
    "never raised": Scene(resting(12, 12.0, share=1.0), refused=("upright_object", 21)),
    "never raised by another": Scene(resting(27, 12.0, share=1.0), refused=("upright_object", 21), slow=True),
    # Before, 3 and 11 of 100: a board that was said to be narrower than a person was none, and where the body behind
    # a narrow board lies in its plane, the planes of both hid the boards.
    **{
        f"{board_m[0]} m wide": Scene(
            resting(1, 10.0, plan="yard", board_m=board_m, hold=BoardHold(body_behind_m=behind_m)),
            fewest=81,
            worst_m=0.3,
        )
        for board_m, behind_m in (((0.35, 0.6), 0.45), ((0.45, 0.6), 0.22))
    },
    "on three rings": Scene(on_three_rings, 0.5),
    "a few near sweeps": Scene(near_sweeps, fewest=4),
    "half bodies": Scene(half_bodies, 0.6),
    # Before, each street gave a vertex. 19 and 23: a wall's end with the board's size, with returns beside the board
    # in its plane. 9549: a door, which taught the detector that boards are held upright. 9612: a pole, in a plane
    # that is turned away by 68 degrees. 9664: a pole, beside a board that would be hidden but for its rim. 9677:
    # something is seen through the board. 12072: a person, taken for a board of 0.08 m.
    **{
        f"street {seed}": Scene(of_a_street(seed), refused=("not_a_board", 1), slow=seed == 9664)
        for seed in (19, 23, 9549, 9612, 9664, 9677)
    },
    "street 12072": Scene(of_a_street(12072, is_known=False), refused=("not_a_board", 1)),
    # Before, 6 and 0 of these sweeps gave a vertex.
    **{
        f"arms forward, {edges}": Scene(arms_forward(edges), refused=("never_shown", 1))
        for edges in ((0.61, 0.91), (0.0, 0.0))
    },
}

each_scene = pytest.mark.parametrize(
    "scene",
    [pytest.param(scene, id=name, marks=[pytest.mark.slow] if scene.slow else []) for name, scene in SCENES.items()],
)
