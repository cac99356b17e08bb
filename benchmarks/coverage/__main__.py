"""`python -m benchmarks.coverage`: does what a calibration states hold, on data with blunders and shared errors?

Pairs are drawn with errors of each cell's law (`draws.py`), or come from whole walks (`whole_walks.py`). DRAWS: of
each cell (default 800); WALKS: whole walks (default 20); CELLS: parts of the names of some cells; SEED: of the first.
By cell: the shares of 95 % intervals that hold, of the mount and of pixels at 5, 20 and 50 m; `gross`: of
the mount's errors beyond 3 deviations; `accused`: of draws by halves.
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
from benchmarks.coverage.whole_walks import WALK_CELLS, walk_scores  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    """Print the cells to stderr and one line of JSON to stdout."""
    draws, walks = int(os.environ.get("DRAWS", "800")), int(os.environ.get("WALKS", "20"))
    seed = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    chosen = [name for name in os.environ.get("CELLS", "").split(",") if name]
    began = time.perf_counter()
    cells, of_walks = (
        [cell for cell in table if not chosen or any(name in cell for name in chosen)]
        for table in (CELLS, WALK_CELLS)
    )
    numbered = [(cell, seed + draw) for cell in cells for draw in range(draws)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        scores = list(pool.map(draw_score, numbered, chunksize=8))
        by_walk = list(pool.map(walk_scores, range(seed, seed + walks if of_walks else seed)))
    figures = {cell: summary(cell, scores[index * draws :][:draws]) for index, cell in enumerate(cells)}
    for column, cell in enumerate(WALK_CELLS):
        if by_walk and cell in of_walks:
            figures[cell] = summary(cell, [scores[column] for scores in by_walk])
    answer = {"bench": "coverage", "seed": seed, "draws": figures, "seconds": round(time.perf_counter() - began, 1)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
