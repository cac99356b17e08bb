"""`python -m benchmarks.coverage`: does what a calibration states hold, on data with blunders and shared errors?

Pairs are drawn with errors of each cell's law (`draws.py`). DRAWS: of each cell (default 800); CELLS: parts of the
names of some cells; SEED: of the first draw. By cell: the shares of 95 % intervals that hold, of the mount's
parameters and of pixels at 5, 20 and 50 m; `gross`: of the mount's errors beyond 3 deviations; `accused`: of draws by
halves.
"""

from __future__ import annotations

import json
import os
import secrets
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.coverage.draws import CELLS, draw_score, summary  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    """Print the cells to stderr and one line of JSON to stdout."""
    draws, seed = int(os.environ.get("DRAWS", "800")), int(os.environ.get("SEED") or secrets.randbelow(10**9))
    chosen = [name for name in os.environ.get("CELLS", "").split(",") if name]
    began = time.perf_counter()
    cells = [cell for cell in CELLS if not chosen or any(name in cell for name in chosen)]
    numbered = [(cell, seed + draw) for cell in cells for draw in range(draws)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        scores = list(pool.map(draw_score, numbered, chunksize=8))
    figures = {cell: summary(cell, scores[index * draws :][:draws]) for index, cell in enumerate(cells)}
    answer = {"bench": "coverage", "seed": seed, "draws": figures, "seconds": round(time.perf_counter() - began, 1)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
