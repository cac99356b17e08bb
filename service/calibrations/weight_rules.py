"""Whether a camera's pairs weigh by the errors that they state; the workers make weights of them."""

from __future__ import annotations

from apexcal.documents.pairs import MARK_SIGMA, SIGMAS, states_errors
from apexcal.documents.rules import WeightRule
from service.db.base import Json
from service.http.problems import Problem


def weighing(camera: str, pairs: Json, wanted: WeightRule) -> Json:
    """The member of the solver's document that says so. Nothing for equal weights: the seed is that of before.

    ``pairs`` is a set's object of columns, each for all its pairs.

    Raises:
        Problem: 422 ``no_covariances``, weights by covariances are asked for and the pairs state none.
    """
    if states_errors(pairs):
        return {} if wanted == "equal" else {"weights": "covariances"}
    if wanted == "covariances":
        raise Problem(
            422,
            "no_covariances",
            f"The pairs of {camera} state no standard deviations that they could weigh by.",
            f"Detect with `refined`, import the columns {', '.join(SIGMAS)} or {MARK_SIGMA}, or leave the choice of "
            "weights out (weights: covariances; --weights covariances).",
            camera=camera,
        )
    return {}


def weighing_note(camera: str, document: Json) -> list[str]:
    """A sentence where the pairs weigh by their errors."""
    if "weights" not in document:
        return []
    return [f"{camera}: pairs weigh by the standard deviations that they state (weights: equal counts all alike)."]
