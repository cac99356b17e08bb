"""A calibration of a simulated walk, as a worker reads it to report on it."""

from __future__ import annotations

from functools import lru_cache
from uuid import UUID

import numpy as np

from apexcal.documents.checks import Check
from apexcal.documents.fit_requests import fit_request
from apexcal.documents.results import FitResult, HeldOut
from tests.support.results import of_block
from tests.workers.solver.rigs import NOMINAL, SIZE, plain, simulated
from tests.workers.solver.walks import ended
from workers.judge.fit_checks import checks_of_fit
from workers.judge.validation_checks import elsewhere
from workers.reports.material import Material, PersonMark
from workers.solver.problem import fit_problem

CURVES = [
    {
        "offset": name,
        "unit": "deg",
        "at": [0.05 * i - 2.0 for i in range(81)],
        "score": [1.0 + 1.0 / (1 + abs(i - 40)) for i in range(81)],
    }
    for name in ("yaw", "pitch", "roll")
]
EDGES = {"kind": "edges", "data": "drive <b>.bag", "at": "2026-01-02 00:00 UTC", "id": "v1", "verdict": "agrees"}
EDGES |= {
    "sentence": "The mount fits.",
    "frames": 30,
    "parts": 900,
    "points": 900,
    "score": 2.0,
    "chance": 1.0,
    "curves": CURVES,
}
PAIRS = {"kind": "pairs", "data": "walk.bag", "at": "2026-01-01 00:00 UTC", "id": "v2", "verdict": "unknown"}
PAIRS |= {"sentence": "5 pairs are too few.", "pairs": 5, "mean_px": 1.0}

_IDS = ("id", "fleet_id", "vehicle_id", "rig_id", "calibration_id", "run_id", "set_id")
_ROWS = {name: str(UUID(int=i)) for i, name in enumerate(_IDS)}
_ROWS |= {"recording_id": None, "detection_id": None, "camera": "front", "fold": -1, "seed": 1}

_NONE_HELD_OUT = Check(
    name="held_out", title="Held-out pairs", verdict="stop", sentence="Nobody held pairs out.", remedy="Hold out.",
    figures={}, scope="mount_with_lens",
)  # fmt: skip


@lru_cache(maxsize=4)
def made(pairs: int = 222, wrong: int = 3, lens: str = "brown_conrady", model: str = "brown_conrady") -> Material:
    """Marks of 1 px, the first ``wrong`` of them 60 px off; two people, one of whom marks 2 px too far right."""
    walked, truth = simulated(lens, 5, pairs=pairs)
    pixels = walked.pixels.copy()
    pixels[:wrong, 1] += 60.0
    known = dict(zip(walked.names, truth.tolist(), strict=True))
    document = {"model": model, "image_size": SIZE, "nominal": NOMINAL, "seed": 1}
    problem = fit_problem(fit_request(**document), walked.points, pixels)
    every_fifth = list(range(0, pairs, 5))
    held = of_block([0.5 + 0.01 * i for i in every_fifth], every_fifth)
    found, result = ended(problem, [known.get(name, 0.0) for name in problem.names])
    made_of = {"request": document, "pairs_sha256": "00", "sources_sha256": "11"}
    result = plain(result.model_copy(update={"checks": checks_of_fit(found, result)})) | {"provenance": made_of}
    result = FitResult.model_validate(result)
    columns = dict(zip("xyz", walked.points.T.tolist(), strict=True))
    columns |= dict(zip("uv", pixels.T.tolist(), strict=True))
    columns["stamp_ns"] = [1_700_000_000_000_000_000 + 400_000_000 * i for i in range(pairs)]
    marks = [PersonMark(i, "Ann", u, v) for i, (u, v) in enumerate(pixels[: pairs // 2].tolist())]
    marks += [PersonMark(i, "Ben </script>$x$", u + 2.0, v) for i, (u, v) in enumerate(pixels.tolist())]
    return Material(
        result=result,
        problem=problem,
        heldout=[HeldOut.model_validate(held)],
        pairs=columns,
        checks=[*(*result.checks, _NONE_HELD_OUT, elsewhere([EDGES, PAIRS]))],
        marks=marks,
        elsewhere=[EDGES, PAIRS],
        names={"vehicle": "van </script>", "rig": "roof", "camera": "front"},
        rows=_ROWS,
        request={"models": ["brown_conrady"]},
        made_at="2026-01-01 00:00 UTC",
    )


def steady(values: list[float | None]) -> np.ndarray:
    """A column of a report's document, NaN where there is no number."""
    return np.array(values, np.float64)
