"""What a camera's fits come to, side by side."""

from uuid import uuid4

from apexcal.documents.results import FitResult
from tests.support.results import fit_result, of_block
from workers.models.summary import CameraFit, recommend


def test_models_whose_folds_differ_are_compared_pair_by_pair():
    def fit(model, fold, indices):
        found = fit_result(model) | {"heldout": of_block([1.0] * len(indices), indices) if indices else None}
        return CameraFit(uuid4(), fold, FitResult.model_validate(found))

    cut = {"pinhole": ([0, 1], [2, 3, 4]), "brown_conrady": ([0, 2, 4], [1, 3])}
    fits = [fit(model, fold, held) for model, folds in cut.items() for fold, held in enumerate(folds)]
    fits += [fit(model, None, []) for model in cut]
    choice, candidates = recommend(fits)
    assert choice.recommended == "pinhole"
    assert [one.heldout.number.tolist() for one in candidates.values()] == [[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]]
