"""Errors on the pairs that a fit held out, by which models are compared."""

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import HeldOut, Outlier
from apexcal.geometry.se3 import to_document
from workers.solver.folds import Fold
from workers.solver.outliers import without
from workers.solver.polish import polish, standard_distances
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.solution import evaluate, lens_of
from workers.solver.weighting import whitened

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
