"""A region is checked by one function; its field takes what that takes, and the API describes it so."""

import json
import math
from typing import get_args

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from apexcal.documents import regions

REGION = TypeAdapter(regions.Region)
SCHEMA = jsonschema.Draft202012Validator(REGION.json_schema())
LEAF = {"quantity": "x", "op": ">", "value": 0}


def says(document):
    """(canonical document, None) or (None, what is wrong)."""
    try:
        return regions.check_region(document), None
    except regions.RegionError as error:
        return None, str(error)


def test_the_description_names_every_quantity_and_operator():
    assert get_args(regions.Quantity) == regions.QUANTITIES
    assert get_args(regions.Operator) == regions.OPERATORS


value = st.one_of(st.floats(), st.integers(-(10**400), 10**400), st.booleans(), st.none(), st.text(max_size=3))
quantity = st.sampled_from([*regions.QUANTITIES, "X", "r", "", None, 3])
bad_leaf = st.fixed_dictionaries(
    {"quantity": quantity, "op": st.sampled_from([*regions.OPERATORS, "==", None]), "value": value},
    optional={"divided_by": st.sampled_from(["x", "range", "w", None]), "extra": st.just(1)},
)
metres = st.floats(-99, 99)
good_leaf = st.fixed_dictionaries(
    {"quantity": st.sampled_from(regions.QUANTITIES), "op": st.just(">"), "value": metres},
    optional={"divided_by": st.sampled_from([*regions.QUANTITIES, None])},
)
some_metres = st.one_of(metres, metres, metres, value)
box = st.fixed_dictionaries(
    {
        "min": st.lists(some_metres, min_size=2, max_size=4),
        "max": st.lists(st.floats(100, 199), min_size=3, max_size=3),
    },
    optional={"yaw_deg": some_metres, "extra": st.just(1)},
).map(lambda members: {"box": members})
polygon = st.fixed_dictionaries(
    {"polygon": st.lists(st.tuples(metres, some_metres).map(list), min_size=2, max_size=6)},
    optional={"z": st.one_of(st.none(), st.lists(metres, min_size=2, max_size=3)), "extra": st.just(1)},
)
parts = st.lists(st.one_of(good_leaf, good_leaf, good_leaf, bad_leaf, box, polygon), max_size=4)
region = st.fixed_dictionaries(
    {"all": parts},
    optional={
        "none": st.one_of(st.none(), parts),
        "up": st.lists(some_metres, min_size=2, max_size=4),
        "extra": st.just(1),
    },
)


@settings(max_examples=400, deadline=None)
@given(region)
def test_what_is_taken_is_as_the_api_describes_it_and_stays_the_same(document):
    taken, wrong = says(document)
    if taken is None:
        with pytest.raises(ValidationError) as refused:
            REGION.validate_python(document)
        (error,) = refused.value.errors(include_url=False)
        assert wrong in error["msg"]
        return
    assert REGION.validate_python(document) == taken
    again = json.loads(json.dumps(taken))
    SCHEMA.validate(again)
    assert says(again) == (taken, None)
    assert REGION.dump_python(taken, mode="json") == taken


@pytest.mark.parametrize("count", [255, 256, 257])
def test_a_region_has_256_parts_of_a_kind_at_most(count):
    assert (says({"all": [LEAF] * count})[1] is None) == (count <= 256)


@pytest.mark.parametrize("corners", [2, 3, 64, 65])
def test_a_polygon_has_3_to_64_corners(corners):
    assert (says({"all": [{"polygon": [[i, i * i] for i in range(corners)]}]})[1] is None) == (3 <= corners <= 64)


@pytest.mark.parametrize(
    ("part", "place"),
    [
        (LEAF["op"], ""),
        ({"all": [LEAF]}, ""),
        ({"all": [{**LEAF, "quantity": "__import__('os')"}]}, ""),
        ({**LEAF, "quantity": "__import__('os')"}, ".quantity"),
        ({**LEAF, "op": "=="}, ".op"),
        ({**LEAF, "op": ["<"]}, ".op"),
        ({**LEAF, "divided_by": "w"}, ".divided_by"),
        ({**LEAF, "value": "1"}, ".value"),
        ({**LEAF, "value": True}, ".value"),
        ({**LEAF, "value": math.nan}, ".value"),
        ({**LEAF, "value": 10**400}, ".value"),
        ({**LEAF, "times": 2}, ""),
        ({"quantity": "x", "op": ">"}, ""),
        ({"box": {"min": [0, 0], "max": [1, 1, 1]}}, ".box.min"),
        ({"box": {"min": [0, 0, 0], "max": [1, "1", 1]}}, ".box.max[1]"),
        ({"box": {"min": [0, 0, 0], "max": [1, 1, 0]}}, ".box"),
        ({"box": [1, 2]}, ".box"),
        ({"box": {"min": [0, 0, 2e6], "max": [1, 1, 3e6]}}, ".box.min[2]"),
        ({"box": {"min": [0, 0, 0], "max": [1, 1, 1], "roll_deg": 3}}, ".box"),
        ({"polygon": [[0, 0], [1, 1]]}, ".polygon"),
        ({"polygon": [[0, 0], [1, 1], [1, math.inf]]}, ".polygon[2][1]"),
        ({"polygon": [[0, 0], [1, 1], [1, 0, 0]]}, ".polygon[2]"),
        ({"polygon": [[0, 0], [1, 1], [1, 0]], "z": [2, 1]}, ".z"),
        ({"polygon": [[0, 0], [1, 1], [1, 0]], "op": "<"}, ""),
    ],
)
@pytest.mark.parametrize("member", ["all", "none"])
def test_what_is_no_part_is_refused_with_its_place(part, place, member):
    refused_at(f"$.{member}[1]{place}", {"all": [LEAF], member: [LEAF, part]})


@pytest.mark.parametrize(
    ("document", "place"),
    [
        ("x > 0", "$"),
        (None, "$"),
        ([LEAF], "$"),
        ({}, "$"),
        (LEAF, "$"),
        ({"all": []}, "$.all"),
        ({"all": "x"}, "$.all"),
        ({"all": LEAF}, "$.all"),
        ({"all": [LEAF], "op": "<"}, "$"),
        ({"none": [LEAF]}, "$"),
        ({"all": [LEAF], "none": []}, "$.none"),
        ({"all": [LEAF], "up": [0, 1]}, "$.up"),
        ({"all": [LEAF], "up": [0, 0, 0]}, "$.up"),
        ({"all": [LEAF], "up": [0, 0, math.nan]}, "$.up[2]"),
    ],
)
def test_what_is_no_region_is_refused_with_its_place(document, place):
    refused_at(place, document)


def refused_at(place, document):
    with pytest.raises(regions.RegionError) as refused:
        regions.check_region(document)
    assert refused.value.code == "region_invalid" and refused.value.hint
    assert f"region {place}:" in refused.value.message
