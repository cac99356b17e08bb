"""`python -m tests.support.kernels solver` and `... detectors`: compile once what processes would each compile.

Numba keeps the machine code beside the source. The two have little in common, so they compile side by side.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from workers.geometry.models import MODELS
from workers.simulation.__main__ import main as simulate
from workers.simulation.camera import make_camera
from workers.solver.slot import warm_up as warm_up_solver
from workers.tasks.warming import warm_up_detectors


def compile_kernels(part: str) -> None:
    """Those of the solver and of each camera model, or those of the detectors and of a simulated walk."""
    if part == "solver":
        warm_up_solver()
        for model in MODELS:
            camera = make_camera(model, 1)
            camera.rays(camera.project(np.array([[9.0, 0.0, 0.0]])))
        return
    warm_up_detectors()
    with tempfile.TemporaryDirectory() as folder:
        assert simulate(["--out", str(Path(folder) / "walk"), "--seconds", "1"]) == 0


if __name__ == "__main__":
    compile_kernels(sys.argv[1])
