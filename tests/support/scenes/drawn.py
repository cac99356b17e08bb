"""Sensors and scenes drawn from wide ranges, one for each seed: nobody chose them, and no threshold fits them.

The ranges are wider than what is known of any one sensor or person. Each names its source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import Disturbances, SecondPerson, WalkName
from tests.support.scenes.flawed_lidar import FlawedLidar, Flaws, Mount
from tests.support.scenes.held_board import BoardHold, HeldWalk
from tests.support.scenes.street import Street
from workers.simulation.lidar import Walks
from workers.simulation.scene import Scene
from workers.simulation.sensors import SENSORS, LidarModel
from workers.simulation.walks import FIELD_HALF_WIDTH_M, FIELD_X_M, YARD_FAR_M

# Elevations and azimuths of the makers' manuals; QT64 and OS0 as published calibration files have them.
_SENSORS = ("vlp16", "vlp32c", "alpha-prime", "os0-128", "os1-32", "os1-64", "os2-128", "xt32", "qt64", "pandar40p")
_PLANS = ("field", "yard", "yard", "cover")
_SECTOR_DEG = 65.0  # wider than the field as seen from the sensor
_HEIGHTS_M = (0.15, 3.0)  # of the region, above the ground

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnScene:
    """One sensor in one scene.

    Attributes:
        noise_m: of a range.
        board_m: edges to the left and to the right of the apex, metres.
        plan: of the walk; None: a street without a board.
        far_m: the walker stays nearer than this.
    """

    seed: int
    sensor: LidarModel
    noise_m: float
    flaws: Flaws
    mount: Mount
    scene: Scene
    disturbances: Disturbances
    hold: BoardHold
    board_m: tuple[float, float]
    plan: WalkName | None
    far_m: float

    def simulated(self, seconds: float) -> tuple[Walks, FlawedLidar]:
        """Who walks where, and the sensor that looks on."""
        ground = self.scene.ground_z
        walk: Walks = (
            Street(self.seed, ground)
            if self.plan is None
            else HeldWalk(
                self.seed,
                seconds,
                ground,
                plan=self.plan,
                disturbances=self.disturbances,
                hold=self.hold,
                board_m=self.board_m,
            )
        )
        lidar = FlawedLidar(
            self.sensor,
            self.scene,
            walk,
            sector_deg=_SECTOR_DEG,
            noise_m=self.noise_m,
            seed=self.seed,
            disturbances=self.disturbances,
            flaws=self.flaws,
            mount=self.mount,
        )
        return walk, lidar

    def region(self) -> Mapping[str, Any]:
        """Where the board is carried, off the ground, as a document in the sensor's frame."""
        return region_before(self.mount, self.scene.ground_z, self.far_m)


def region_before(mount: Mount, ground_z: float, far_m: float) -> Mapping[str, Any]:
    """Where boards are carried up to a distance, off the ground, as a document for the sensor's frame."""
    low, high = (ground_z + above for above in _HEIGHTS_M)
    box = {"box": {"min": [2.0, -6.2, low], "max": [far_m + 0.3, 6.2, high]}}
    return {"all": [box], "up": mount.rotation()[2].tolist()}


def draw(seed: int) -> DrawnScene:
    """The sensor, scene, person and board of that seed."""
    random = np.random.default_rng([seed, 20])
    plan = str(random.choice(_PLANS))
    far_m = YARD_FAR_M if plan == "yard" else FIELD_X_M[1]
    board_m = _board(random)
    # Data sheets state 5 mm (XT32) to 30 mm (VLP-16).
    sensor, noise_m = _sensor(random), float(np.exp(random.uniform(math.log(0.003), math.log(0.02))))
    flaws, mount, scene = _flaws(random), _mount(random), _scene(random, far_m)
    disturbances, hold = _disturbances(random, board_m)
    return DrawnScene(
        seed=seed,
        sensor=sensor,
        noise_m=noise_m,
        flaws=flaws,
        mount=mount,
        scene=scene,
        disturbances=disturbances,
        hold=hold,
        board_m=board_m,
        plan=plan,
        far_m=far_m,
    )


def draw_street(seed: int) -> DrawnScene:
    """A street without a board: poles, cars, doors, signs and people, and a sensor as :func:`draw` draws it."""
    random = np.random.default_rng([seed, 21])
    drawn = draw(seed)
    poles = random.uniform((4.0, -6.0, 0.03, 1.5), (30.0, 6.0, 0.2, 5.0), (random.integers(2, 9), 4))
    boxes = np.concatenate([*(_car(random, 5.0, 30.0) for _ in range(4)), *(_sign(random) for _ in range(6))])
    scene = replace(drawn.scene, poles=poles, boxes=boxes)
    return replace(drawn, scene=scene, plan=None, far_m=FIELD_X_M[1])


def _sensor(random: np.random.Generator) -> LidarModel:
    """One of the makers' tables at one of its rates; its motor turns faster and its lasers fire as before."""
    sensor = SENSORS[str(random.choice(_SENSORS))]
    faster = float(random.choice([0.5, 1.0, 1.0, 1.0, 2.0]))
    return replace(sensor, rate_hz=sensor.rate_hz * faster, step_deg=sensor.step_deg * faster)


def _flaws(random: np.random.Generator) -> Flaws:
    return Flaws(
        ring_bias_m=random.uniform(0.0, 0.012),  # measured on real planes: 1 to 15 mm
        ring_angle_deg=random.uniform(0.0, 0.02),  # twice what Ouster's data sheets state
        intensity_m=random.uniform(-0.01, 0.02),  # black against white; measured: -10 to +9 mm
        incidence_m=random.uniform(0.0, 0.01),  # at 60 degrees from the normal; assumed: a tenth of a pulse's rise
        mixing_m=random.uniform(0.3, 1.0),  # half of a pulse of 2 to 7 ns
        least_share=random.uniform(0.05, 0.4),  # of a beam that answers: edges grow by up to half a beam
        lost_share=random.uniform(0.0, 0.5),  # of black or slanted surfaces; measured: 0 to 10 % inside a board
        wander_deg=random.uniform(0.0, 0.3),  # assumed
        jitter_mrad=random.uniform(0.0, 0.15),  # measured: 0.08 to 0.13
    )


def _mount(random: np.random.Generator) -> Mount:
    """Tilted by some degrees (assumed); the seam anywhere, so that it lies in the field in every third draw."""
    roll, pitch = np.clip(random.normal(0.0, 4.0, 2), -12.0, 12.0).tolist()
    return Mount(roll_deg=roll, pitch_deg=pitch, seam_deg=random.uniform(-180.0, 180.0))


def _board(random: np.random.Generator) -> tuple[float, float]:
    """Square in every third draw, else longer to the left or right. Published boards: 0.61 x 0.85 to 0.89 x 1.2 m."""
    short = random.uniform(0.5, 1.0)
    long = short * (1.0 if random.uniform() < 0.33 else random.uniform(1.1, 1.6))
    sides = (short, min(long, 1.3))
    return sides if random.uniform() < 0.5 else (sides[1], sides[0])


def _disturbances(random: np.random.Generator, board_m: tuple[float, float]) -> tuple[Disturbances, BoardHold]:
    """Somebody who holds the board between edges that fall alike and an upright diagonal, and rolls and leans it.

    People roll boards by 10 to 15 degrees and lean them by slopes of -0.6 to 0.7. Their bodies follow DIN 33402-2.
    """
    hang_deg = math.degrees(math.atan2(*board_m)) - 45.0
    rolled_deg = hang_deg * random.uniform(0.0, 1.0) + np.clip(random.normal(0.0, 6.0), -15.0, 15.0)
    torso_m = random.uniform(0.13, 0.22)
    disturbances = Disturbances(
        beam_mrad=random.uniform(1.0, 5.0),  # data sheets: 1.6 (OS2) to 6 (OS0)
        dropouts=random.uniform(0.0, 0.05),
        speckle=random.uniform(0.0, 0.002),
        walker_height_m=random.uniform(1.55, 1.95),
        head_above_m=random.uniform(0.03, 0.2) if random.uniform() < 0.25 else 0.0,
        second_person=get_args(SecondPerson)[int(random.choice(3, p=[0.6, 0.2, 0.2]))],
    )
    hold = BoardHold(
        rolled_deg=float(np.clip(rolled_deg, -30.0, 30.0)),
        tilted_deg=float(np.clip(random.normal(0.0, 7.0), -20.0, 20.0)),
        body_behind_m=torso_m + random.uniform(0.02, 0.45),
        torso_m=torso_m,
        hand_m=random.uniform(0.035, 0.07) if random.uniform() < 0.7 else 0.0,
    )
    return disturbances, hold


def _scene(random: np.random.Generator, far_m: float) -> Scene:
    """A wall close behind the walker's field, cars and signs along its sides."""
    scene = Scene(ground_z=-random.uniform(0.9, 2.4), wall_x=far_m + random.uniform(0.8, 6.0))
    side = FIELD_HALF_WIDTH_M + 0.5
    beside = [_car(random, 5.0, far_m, side) for _ in range(random.integers(0, 5))]
    behind = [_car(random, far_m + 0.8 + 0.9, far_m + 2.0)] if random.uniform() < 0.5 else []
    return replace(scene, boxes=np.concatenate([np.empty((0, 7)), *beside, *behind]))


def _car(random: np.random.Generator, near_m: float, far_m: float, side_m: float | None = None) -> Floats:
    """Body and cabin (2, 7); along the street at that distance to a side, else across it, between the distances."""
    half_length, half_width = random.uniform(1.8, 2.5), random.uniform(0.8, 0.95)
    x = random.uniform(near_m, far_m)
    side = random.choice([-1.0, 1.0])
    y = random.uniform(-5.0, 5.0) if side_m is None else side * (side_m + half_width + random.uniform(0.0, 1.5))
    heading = random.normal(math.pi / 2.0 if side_m is None else 0.0, 0.05)
    waist, roof = random.uniform(0.8, 1.0), random.uniform(1.35, 1.9)
    body = [x, y, heading, half_length, half_width, 0.2, waist]
    cabin = [x, y, heading, 0.55 * half_length, 0.85 * half_width, waist, roof]
    return np.array([body, cabin])


def _sign(random: np.random.Generator) -> Floats:
    """A door, a board wall or a sign on its post (1, 7): thin, upright, turned anywhere."""
    low = random.choice([0.0, random.uniform(0.8, 2.2)])
    high = low + (random.uniform(1.8, 2.2) if low == 0.0 else random.uniform(0.3, 1.0))
    where = (random.uniform(4.0, 30.0), random.uniform(-5.5, 5.5), random.uniform(0.0, math.pi))
    return np.array([[*where, random.uniform(0.15, 0.6), random.uniform(0.005, 0.03), low, high]])
