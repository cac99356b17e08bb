"""A person who aims beside the corner is told by the machine's marks, and the stated errors count it."""

import numpy as np
import pytest

from apexcal.documents.person_bias import SHARED, person_px
from apexcal.documents.results import FitResult
from tests.support.results import fit_result
from workers.judge.people_check import people

HABIT_PX = 0.289
ALONE_PX = 1.0


def marked(*shifts_px, marks=20, seed=1):
    """Columns of people's blind marks, each person's off by a shift (u, v) from the machine's."""
    random = np.random.default_rng(seed)
    off = [(-np.array(shift) + random.normal(0.0, 0.8, 2)).tolist() for shift in shifts_px for _ in range(marks)]
    return {"marked_by": [[i] for i in range(len(shifts_px)) for _ in range(marks)], "machine_off_px": off}


def result(people_count=1):
    bias = {"px": 0.3, "freedom": 4.5, "people": people_count}
    return FitResult.model_validate(fit_result(person_bias=bias, common_errors={"person_px": HABIT_PX}))


def test_a_person_beside_the_corner_is_looked_at_and_widens_what_is_stated():
    check = people(result(), marked((1.5, 0.0)))
    assert check.verdict == "look" and "Marks of person 1 lie" in check.sentence and "in u" in check.sentence
    assert check.figures["off_px"] == pytest.approx(1.5, abs=0.5)
    # 1.5 px along one of two coordinates.
    assert person_px(marked((1.5, 0.0)), HABIT_PX, ALONE_PX) == pytest.approx(1.5 / np.sqrt(2.0), abs=0.3)
    of_three = marked((0.1, 0.1), (1.5, 0.0), (-0.1, 0.0))
    assert "person 2" in people(result(3), of_three).sentence
    assert HABIT_PX < person_px(of_three, HABIT_PX, ALONE_PX) < person_px(marked((1.5, 0.0)), HABIT_PX, ALONE_PX)


def test_people_who_aim_at_the_corner_pass_and_nothing_is_widened():
    sound = [people(result(), marked((0.0, 0.0), seed=seed)).verdict for seed in range(40)]
    assert sound == ["pass"] * 40
    assert max(person_px(marked((0.0, 0.0), seed=seed), HABIT_PX, ALONE_PX) for seed in range(40)) < 0.45
    still = {"marked_by": [[0]] * 6, "machine_off_px": [[0.0, 0.0]] * 6}
    assert people(result(), still).verdict == "pass"


def test_a_person_alone_and_unseen_is_not_checked():
    for pairs in ({}, {"marked_by": [[0]] * 9}, marked((1.5, 0.0), marks=4)):
        check = people(result(), pairs)
        assert check.verdict == "not_checked" and "0.29 px" in check.sentence and "second person" in check.remedy
        assert person_px(pairs, HABIT_PX, ALONE_PX) == (ALONE_PX if pairs else HABIT_PX)
    assert person_px({"marked_by": [[0], [1]]}, HABIT_PX, ALONE_PX) == HABIT_PX
    assert people(result(), {"machine": [True, True]}).verdict == "pass"


def test_rims_shift_the_machines_marks_alike_and_the_more_the_less_sure_they_are():
    def of_machine(*sigmas_px):
        machine = [sigma is not None for sigma in sigmas_px]
        return {"machine": machine, "sigma_px": list(sigmas_px), "marked_by": [[0]] * len(machine)}

    assert person_px(of_machine(0.2, 0.3), HABIT_PX, ALONE_PX) == HABIT_PX
    unsure = person_px(of_machine(1.4, 1.4), HABIT_PX, ALONE_PX)
    assert unsure == pytest.approx(SHARED * 1.4)
    half = person_px(of_machine(1.4, None), HABIT_PX, ALONE_PX)
    assert half == pytest.approx(np.sqrt(0.5 * (unsure**2 + ALONE_PX**2))), "a person alone marked the other half"
