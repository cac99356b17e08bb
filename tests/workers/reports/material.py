"""A calibration of a simulated walk by two models, as a worker reads it to report on it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from apexcal.documents.checks import Check
from apexcal.documents.fit_requests import fit_request
from apexcal.documents.results import FitResult, HeldOut
from tests.support.results import of_block
from tests.workers.solver.rigs import NOMINAL, SIZE, plain, simulated
from tests.workers.solver.walks import ended
from workers.judge.fit_checks import checks_of_fit
from workers.judge.validation_checks import elsewhere
from workers.reports.material import FittedModel, Material, PersonMark
from workers.solver.problem import fit_problem

MODELS = ("pinhole", "brown_conrady")
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
    fitted: list[FittedModel] = []
    for name in {*MODELS, lens, model}:
        document = {"model": name, "image_size": SIZE, "nominal": NOMINAL, "seed": 1}
        problem = fit_problem(fit_request(**document), walked.points, pixels)
        start = [known.get(one, 0.0) for one in problem.names]
        every_fifth = list(range(0, pairs, 5))
        held = of_block([0.5 + 0.01 * i for i in every_fifth], every_fifth)
        found, result = ended(problem, start)
        made_of = {"request": document, "pairs_sha256": "00", "sources_sha256": "11"}
        result = plain(result.model_copy(update={"checks": checks_of_fit(found, result)})) | {"provenance": made_of}
        fitted.append(FittedModel(FitResult.model_validate(result), problem, [HeldOut.model_validate(held)]))
    fitted.sort(key=lambda one: one.result.model)
    columns = dict(zip("xyz", walked.points.T.tolist(), strict=True))
    columns |= dict(zip("uv", pixels.T.tolist(), strict=True))
    columns["stamp_ns"] = [1_700_000_000_000_000_000 + 400_000_000 * i for i in range(pairs)]
    marks = [PersonMark(i, "Ann", u, v) for i, (u, v) in enumerate(pixels[: pairs // 2].tolist())]
    marks += [PersonMark(i, "Ben </script>$x$", u + 2.0, v) for i, (u, v) in enumerate(pixels.tolist())]
    chosen = next(one for one in fitted if one.result.model == model)
    return Material(
        chosen=chosen,
        models=fitted,
        pairs=columns,
        checks=[*(*chosen.result.checks, _NONE_HELD_OUT, elsewhere([EDGES, PAIRS]))],
        recommended="brown_conrady",
        slots=[(i, slot, 3.0 / (i + 1) + 0.1 * slot) for i in range(4) for slot in range(3)],
        marks=marks,
        elsewhere=[EDGES, PAIRS],
        names={"vehicle": "van </script>", "rig": "roof", "camera": "front"},
        ids={"result": "r1", "calibration": "c1"},
        request={"models": list(MODELS)},
        made_at="2026-01-01 00:00 UTC",
    )


def steady(values: list[float | None]) -> np.ndarray:
    """A column of a report's document, NaN where there is no number."""
    return np.array(values, np.float64)
