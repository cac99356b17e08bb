"""Pairs that a fit holds out together, and the errors on them, by which models are compared.

Blocks of time, or whole poses, are held out; never a frame beside its neighbours.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.folds import cut_folds, most_folds
from apexcal.documents.results import HeldOut, Outlier
from apexcal.geometry.se3 import to_document
from workers.solver.outcomes import SolveError
from workers.solver.outliers import without
from workers.solver.polish import polish, standard_distances
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.solution import evaluate, lens_of
from workers.solver.weighting import whitened

Integers = NDArray[np.int64]


class Fold(NamedTuple):
    """The pairs of one fold (ascending), and for each of them its block: blocks err together."""

    indices: Integers
    blocks: Integers


def folds(groups_or_stamps: ArrayLike, count: int) -> list[Fold]:
    """Folds that together hold every pair once; see :func:`apexcal.documents.folds.cut_folds`.

    groups_or_stamps (N,): time stamps (any unit), or a group per pair (a pose, a recording).
    Raises SolveError `bad_folds` where there are too few values: at least two per fold of stamps that are all
    different (else a fold would be a single frame), at least one group per fold.
    """
    values: NDArray[Any] = np.asarray(groups_or_stamps)
    if values.ndim != 1 or values.size == 0:
        raise SolveError("bad_folds", "There are no groups or stamps to make folds of.", "Give one for each pair.")
    if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
        raise SolveError("bad_folds", "A stamp is not finite.", "")
    different = len(np.unique(values))
    if count < 2 or count > most_folds(different, values.size):
        raise SolveError(
            "bad_folds",
            f"{different} different {'stamps' if different == values.size else 'groups'} cannot make {count} folds.",
            "Ask for at least 2 folds, and for fewer than there are poses, or half as many as there are frames.",
        )
    cut = cut_folds(values.tolist(), count)
    fold, block = np.array(cut.fold, np.int64), np.array(cut.block, np.int64)
    taken = [np.flatnonzero(fold == index).astype(np.int64) for index in range(count)]
    return [Fold(indices, block[indices]) for indices in taken]


Floats = NDArray[np.float64]


def held_out(problem: FitProblem, whole: FitProblem, fold: Fold, p: Floats, outliers: list[Outlier]) -> HeldOut:
    """The errors of the fit p (D,) of `problem` on the pairs of `whole` that `fold` holds out.

    `indices` and `blocks` are of these pairs; `standard_px`, their distances in standard
    deviations of what they state, in px of a typical pair; `stretch`, by which that whitening scales lengths there
    (equal weights: the plain distances and 1). They are under a fit without its named outliers, because the effect of
    one gross error on a model says nothing of the model.
    """
    indices = fold.indices
    lens, transform = lens_of(problem, p).model_dump(exclude_unset=True), to_document(transform_of(problem, p))
    errors = evaluate(lens, transform, whole.points[indices], whole.pixels[indices])
    p = _without_outliers(problem, p, outliers)
    here = whitened(whole, p)
    stretch = np.ones(len(indices))
    if here.whitening is not None:
        stretch = np.sqrt(np.abs(np.linalg.det(here.whitening[indices])))
    return HeldOut(
        **errors,
        indices=indices.tolist(),
        blocks=fold.blocks.tolist(),
        standard_px=standard_distances(here, p)[indices].tolist(),
        stretch=stretch.tolist(),
    )


def _without_outliers(problem: FitProblem, p: Floats, outliers: list[Outlier]) -> Floats:
    # A saturating loss already gives them almost no weight.
    if not outliers or problem.outliers == "exclude" or problem.loss == "saturating":
        return p
    return np.array(polish(without(problem, outliers), p).parameters)
