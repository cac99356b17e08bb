"""Inequalities as people type them."""

import pytest

from apexcal.errors import ClientError
from apexcal.regions import parse_region, read_region


def test_inequalities_become_a_conjunction():
    assert parse_region(["x > 0", "range<=9.5", "z/x>-2e-1"]) == {
        "all": [
            {"quantity": "x", "op": ">", "value": 0.0},
            {"quantity": "range", "op": "<=", "value": 9.5},
            {"quantity": "z", "divided_by": "x", "op": ">", "value": -0.2},
        ]
    }


def test_one_inequality_is_itself():
    assert parse_region(["azimuth_deg < 45"]) == {"all": [{"quantity": "azimuth_deg", "op": "<", "value": 45.0}]}


@pytest.mark.parametrize("text", ["x = 1", "w > 1", "x > y", "x > 1.2.3", "__import__('os')", "x > 1 and y < 2", ""])
def test_anything_else_is_refused_by_quoting_it(text):
    with pytest.raises(ClientError) as refused:
        parse_region([text])
    assert repr(text) in str(refused.value)
    assert "z / x > 0.2" in refused.value.hint


def test_a_region_file_must_hold_one(tmp_path):
    path = tmp_path / "region.json"
    for text in ("[1]", "{", ""):
        path.write_text(text)
        with pytest.raises(ClientError, match=r"region"):
            read_region(path)
    path.write_text('{"lidar": {}, "cameras": []}')
    with pytest.raises(ClientError, match="is no region"):
        read_region(path)
    path.write_text('{"all": []}')
    assert read_region(path) == {"all": []}


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999"])
def test_a_region_file_holds_finite_numbers(tmp_path, number):
    path = tmp_path / "region.json"
    path.write_text(f'{{"all": [{{"quantity": "x", "op": ">", "value": {number}}}]}}')
    with pytest.raises(ClientError, match=rf"region\.json holds {number}") as refused:
        read_region(path)
    assert "finite number" in refused.value.hint


def test_an_inequality_compares_with_a_finite_number():
    with pytest.raises(ClientError, match="'x > 1e999'") as refused:
        parse_region(["z > 0", "x > 1e999"])
    assert "finite number" in refused.value.hint
