"""What a camera's fits come to, side by side."""

from uuid import uuid4

from tests.workers.tasks.test_concluding import document, of_block
from workers.models.summary import Fit, recommend


def test_folds_that_hold_out_a_pair_twice_count_it_once():
    def fit(model, fold, indices):
        heldout = of_block([1.0] * len(indices), indices)
        return Fit(uuid4(), model, fold, document(1.0, model=model) | {"heldout": heldout})

    cut = {"pinhole": ([0, 1, 2, 3], [2, 3, 4]), "brown_conrady": ([0, 2, 4], [1, 3])}
    fits = [fit(model, fold, held) for model, folds in cut.items() for fold, held in enumerate(folds)]
    fits += [fit(model, None, []) for model in cut]
    choice, candidates = recommend(fits)
    assert choice.recommended == "pinhole"
    assert [one.heldout.number.tolist() for one in candidates.values()] == [[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]]
