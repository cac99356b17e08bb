"""Drives over simulated roads, and the calibration that recorded them."""

from functools import cache

import numpy as np

from apexcal.geometry.se3 import to_document
from tests.support.scenes.drive import Drive, record
from tests.support.scenes.road import draw_road
from workers.simulation.camera import LENSES, SimulatedCamera, nominal_mount
from workers.simulation.sensors import SENSORS
from workers.validation.calibration import KnownCalibration

WIDTH, HEIGHT = 480, 300


def camera(width=WIDTH, height=HEIGHT):
    """60 degrees wide, nearly level."""
    f = width / 2 / np.tan(np.radians(30.0))
    lens = LENSES["pinhole"] | {"f_x": f, "f_y": f, "c_x": width / 2, "c_y": height / 2}
    return SimulatedCamera("pinhole", lens, (width, height), nominal_mount(pitch_down_deg=4.0))


def calibration(turn_deg=(0.0, 0.0, 0.0)):
    """The camera's own, or turned about its axes."""
    made = camera()
    known = {"intrinsics": made.intrinsics_document(), "transform": to_document(made.T_camera_lidar)}
    return KnownCalibration.of(known).moved(np.array(turn_deg), np.zeros(3))


@cache
def drive(seed, frames=4, *, is_empty=False, is_painted=True):
    """Sweeps of an OS1-64 with their frames."""
    road = draw_road(seed, is_empty=is_empty, is_painted=is_painted)
    return list(record(road, Drive(every_s=1.0), SENSORS["os1-64"], camera(), seed, frames))


def checked(kind, seen, turn_deg=(0.0, 0.0, 0.0)):
    """What a check says of a drive under a calibration that is off by a turn (pitch, yaw, roll)."""
    check = kind(calibration(turn_deg))
    for sweep, image in seen:
        check.add(sweep, image if kind.__name__ == "LaneCheck" else image[..., 1])
    return check.result()
