"""`python -m benchmarks.worth`: success against what makes a calibration hard, as one line of JSON.

RIGS (default 24) fresh rigs a point, shared among the camera models; QUESTIONS narrows, SEED repeats a run. Seconds
are processor seconds of one core.
"""

import json
import os
import secrets
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from benchmarks.worth.methods import METHODS, RIGHT_PX  # noqa: E402
from benchmarks.worth.questions import QUESTIONS, answer  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    rigs, seed = int(os.environ.get("RIGS", "24")), int(os.environ.get("SEED") or secrets.randbits(31))
    names = os.environ.get("QUESTIONS", ",".join(QUESTIONS)).split(",")
    points = [(name, index) for name in names for index in range(len(QUESTIONS[name].values))]
    places = [(*point, number) for point in points for number in range(rigs)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        ways = dict(zip(places, pool.map(partial(answer, seed=seed), places), strict=True))

    def curve(name: str, way: str, figure: str) -> list[float]:
        """A figure's mean along the values."""
        rows = [[ways[name, index, n][way][figure] for n in range(rigs)] for at, index in points if at == name]
        return np.round(np.mean(rows, axis=1), 4).tolist()

    curves = {
        name: {"values": QUESTIONS[name].values}
        | {
            way: {figure: curve(name, way, figure) for figure in ("success", "right", "seconds")}
            for way in ("optimum", *METHODS)
        }
        for name in names
    }
    print(json.dumps({"rigs": rigs, "seed": seed, "right_px": RIGHT_PX, "curves": curves}))


if __name__ == "__main__":
    main()
