"""`python -m tests.support.kernels`: compile once what processes of tests would each compile at the same time.

Numba keeps the machine code beside the source.
"""

import tempfile
from pathlib import Path

import numpy as np

from workers.geometry.models import MODELS
from workers.simulation.__main__ import main as simulate
from workers.simulation.camera import make_camera
from workers.tasks.warming import warm_up


def compile_kernels() -> None:
    """Those of the workers, of each camera model, and of a simulated walk."""
    warm_up()
    for model in MODELS:
        camera = make_camera(model, 1)
        camera.rays(camera.project(np.array([[9.0, 0.0, 0.0]])))
    with tempfile.TemporaryDirectory() as folder:
        assert simulate(["--out", str(Path(folder) / "walk"), "--seconds", "1"]) == 0


if __name__ == "__main__":
    compile_kernels()
