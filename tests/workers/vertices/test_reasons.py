"""A refusal names its cause, with the numbers of what was seen."""

import re

import numpy as np
import pytest

from tests.support.scenes.held_board import BoardHold
from tests.workers.vertices.refined_walks import REGION, SIZE, walk
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region


@pytest.mark.parametrize(
    ("hold", "cause"),
    [
        (BoardHold(tilted_deg=45.0), "boards lean up to 35"),
        (BoardHold(turned_deg=72.0), "boards are turned by up to 60"),
        (BoardHold(rolled_deg=45.0), "boards stand on their tip"),
    ],
)
def test_what_no_board_does_is_said_with_its_number(hold, cause):
    recorded = walk(27, 8.0, hold=hold)
    found = detect_range(recorded.source, REGION, "refined", SIZE, indices=recorded.all)
    assert found.rejected["not_a_board"] > 20
    sweep, said = re.fullmatch(r"sweep (\d+): a flat thing of .* rings, (.*)", found.examples["not_a_board"]).groups()
    assert found.refused[int(sweep)] == "not_a_board"
    assert cause in said


def test_a_board_outside_of_the_region_is_found_and_named():
    recorded = walk(27, 8.0)
    elsewhere = Region.from_document({"all": [{"box": {"min": [2.0, 3.0, -1.5], "max": [6.0, 6.0, 1.5]}}]})
    found = detect_range(recorded.source, elsewhere, "refined", SIZE, indices=recorded.all)
    sweep, x, y = re.fullmatch(
        r"sweep (\d+): .* at x (\S+), y (\S+) m", found.examples["outside_the_region"]
    ).groups()
    assert np.array([float(x), float(y)]) == pytest.approx(recorded.apex[int(sweep), :2], abs=0.2)
    halves = [
        detect_range(recorded.source, elsewhere, "refined", SIZE, indices=part).rejected
        for part in (range(40), range(40, 80))
    ]
    assert sum(half["outside_the_region"] for half in halves) == found.rejected["outside_the_region"]
