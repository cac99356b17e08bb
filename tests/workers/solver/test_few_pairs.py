"""Pairs that tell little end as a result or as a refusal, never as a number that is none."""

import json

import pytest

from tests.workers.solver.draws import few_or_many
from tests.workers.solver.few_pairs import KINDS, calibrated, drawn, real
from workers.solver.outcomes import SolveError


def ends(document, pairs):
    """Whether there is a result, and what its documents say; a refusal says what to do."""
    try:
        return [json.loads(text) for text in calibrated(document, pairs)]
    except SolveError as error:
        assert error.code in ("too_few_pairs", "bad_folds", "bad_covariances"), error
        return None


@few_or_many(1, 60)
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_pairs_of_every_kind_end_as_a_result_or_as_a_refusal(kind, draws):
    ended = [ends(*drawn(len(KINDS) * draw + kind)) for draw in range(draws)]
    assert any(ended) or KINDS[kind] in ("one_point", "one_pixel", "behind")


@few_or_many(8, 400)
def test_two_or_three_real_poses_end_as_a_result_or_as_a_refusal(draws):
    ended = [ends(*real(1010 + draw)) for draw in range(draws)]
    assert sum(one is not None for one in ended) > draws // 2


@pytest.mark.parametrize(("draw", "seed"), [(real, 4), (real, 30), (real, 1025), (drawn, 13), (drawn, 63)])
def test_draws_that_once_ended_as_a_defect(draw, seed):
    assert ends(*draw(seed)) is not None


def test_a_report_of_a_camera_that_sees_no_point_says_so():
    document, pairs = drawn(13)
    result = ends(document, pairs)[0]
    (check,) = [check for check in result["checks"] if check["name"] == "fit"]
    assert check["verdict"] == "stop"
    assert "behind the camera" in check["sentence"]
