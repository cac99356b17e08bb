"""What is published by itself where marks are wrong: the same for a vehicle's request and for a fleet's."""

from __future__ import annotations

import pytest

from tests.faults.jobs import pairs
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.databases import one_database
from tests.support.work import work

from .conftest import QUICK, Vans

ASKED = QUICK | {"publish": "recommended", "folds": 2}


def marked(vans: Vans, name: str, wrong: int) -> dict[str, str]:
    """A van with 106 pairs, of which so many have their mark on the hand that holds the board, 40 px below."""
    van = vans.add(name, None)
    marks = pairs(106)
    for one in marks[:: 106 // wrong if wrong else 107][:wrong]:
        one["v"] += 40.0
    return van | {"set": bring_pairs(vans.engineer, van["rig"], marks)}


@one_database
@pytest.mark.parametrize("by_fleet", [False, True])
def test_seventeen_of_106_wrong_marks_publish_nothing_by_themselves(vans: Vans, context, by_fleet):
    van = marked(vans, "van", 17)
    if by_fleet:
        vans.ask(calibration=ASKED)
    else:
        ask_calibration(vans.engineer, van["vehicle"], van["set"], **ASKED)
    work(context)
    (calibration,) = vans.engineer.get(f"/vehicles/{van['vehicle']}/calibrations").json()["items"]
    front = calibration["summary"]["cameras"]["front"]
    (wrong,) = (one for one in front["checks"] if one["name"] == "wrong_pairs")
    assert wrong["verdict"] != "pass" and wrong["remedy"], wrong
    assert front["published"] is False
    result = vans.engineer.get(f"/results/{front['models']['pinhole']['result_id']}").json()
    assert result["checks"] == front["checks"]
    current = vans.engineer.get(f"/vehicles/{van['vehicle']}/cameras/front/calibration")
    assert current.json()["code"] == "no_calibration_yet"
