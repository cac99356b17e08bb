"""`python -m benchmarks.coverage`: does what a calibration publishes hold, end to end?

First pairs are drawn, with errors of each cell's law (`draws.py`; DRAWS: of each cell, default 800). `draws` has, by
cell, the shares of 95 % intervals that hold: of the mount's parameters and of pixels at 5, 20 and 50 m; `gross`: of
the mount's errors beyond 3 deviations; `accused`: of draws by halves.

Then walks are simulated, their vertices detected, paired at the estimated offset, marked by simulated people (a bias
of each person, noise, some marks on another corner of the board), and calibrated by all models. Each recording gives
one calibration to every cell. RUNS: recordings (default 6, a quarter of an hour on two cores); CELLS: parts of the
names of some cells; SEED: of the first. DRAWS=0 or RUNS=0 leaves a part out.

`worst_coverage95`, `best_coverage95`: the least and largest share over the cells of published 95 % intervals that
hold, of rotation, translation and pixels over the marked field. `worst_by_chance`, `best_by_chance`: the same if the
cells differed by chance alone; a cell has few recordings. `sound_accused`: sound runs whose status is not `ok`.
`right_model`: runs whose recommended lens is the true one, or predicts within 0.5 px of it with the mount within what
is stated. `halves_ratio_median`: of sound runs. `shared_error_named`: of the runs whose groups of four pairs share
errors of 10 mm (`four_a_pose`) or whose mount turns by 0.08 degrees in the second half (`second_half`, 1920 x 1200
pixels), those whose results report it. `second_half_bound`: the largest share that a test can name if it accuses one
in twenty sound recordings; `second_half_960`: the same with 960 x 600 pixels. `six_poses`: 210 pairs of six poses of
a still board, each off by 10 mm and 1.5 degrees; 0.88 of its intervals should hold. `sound_doubted`: sound runs whose
results report shared errors or a turn.
"""

from __future__ import annotations

import json
import os
import secrets
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.coverage.draws import CELLS, draw_score  # noqa: E402
from benchmarks.coverage.draws import summary as of_draws  # noqa: E402
from benchmarks.coverage.figures import summary  # noqa: E402
from benchmarks.coverage.runs import recording  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    """Print the cells to stderr and one line of JSON to stdout."""
    runs, seed = int(os.environ.get("RUNS", "6")), int(os.environ.get("SEED") or secrets.randbelow(10**9))
    draws = int(os.environ.get("DRAWS", "800"))
    chosen = [name for name in os.environ.get("CELLS", "").split(",") if name]
    began = time.perf_counter()
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        cells = [cell for cell in CELLS if not chosen or any(name in cell for name in chosen)] if draws else []
        numbered = [(cell, seed + draw) for cell in cells for draw in range(draws)]
        results = list(pool.map(draw_score, numbered, chunksize=8))
        of_cell = {cell: results[index * draws : (index + 1) * draws] for index, cell in enumerate(cells)}
        drawn = {cell: of_draws(cell, scores) for cell, scores in of_cell.items()}
        scored = [one for found in pool.map(partial(recording, seed, chosen), range(runs)) for one in found]
    figures = {"draws": drawn, **(summary(scored) if runs else {})}
    print(
        json.dumps(
            {
                "bench": "coverage",
                "seed": seed,
                "runs": runs,
                **figures,
                "seconds": round(time.perf_counter() - began, 1),
            }
        )
    )


if __name__ == "__main__":
    main()
