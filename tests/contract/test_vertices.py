"""Service and workers speak of regions and detectors in the same words."""

import json
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from service.detections import detectors, regions, schemas
from workers.vertices import detectors as worker_detectors
from workers.vertices import pairing, region_document, vertex
from workers.vertices import region as worker_region

REGION = TypeAdapter(regions.Region)


def service_says(document):
    """(canonical document, None) or (None, what is wrong)."""
    try:
        return REGION.validate_python(document), None
    except ValidationError as error:
        (found,) = error.errors(include_url=False)
        return None, found["msg"] if str(found["type"]).startswith("region_") else "Input should be an object"


def worker_says(document):
    try:
        return worker_region.Region.from_document(document).document, None
    except region_document.RegionError as error:
        return None, f"{error.message} {error.hint}"


def test_detectors_have_the_same_names_options_limits_and_defaults():
    ours = {}
    for name, options in detectors.DETECTORS.items():
        properties = options.model_json_schema()["properties"]
        ours[name] = {
            key: {member: value[member] for member in ("type", "default", "minimum", "maximum")}
            for key, value in properties.items()
        }
    theirs = {
        name: {
            key: {member: value[member] for member in ("type", "default", "minimum", "maximum")}
            for key, value in detector.options_schema["properties"].items()
        }
        for name, detector in worker_detectors.DETECTORS.items()
    }
    assert ours == theirs


def test_flags_classes_and_ways_of_pairing_are_the_same():
    assert dict(vertex.FLAGS) == detectors.FLAGS
    assert get_args(schemas.Quality) == get_args(vertex.Quality)
    assert get_args(schemas.Pairing.model_fields["mode"].annotation) == pairing.PAIRING_MODES


def test_quantities_operators_and_limits_are_the_same():
    for name in ("QUANTITIES", "OPERATORS", "MAX_DEPTH", "MAX_NODES", "MAX_CORNERS", "MAX_METRES"):
        assert getattr(regions, name) == getattr(region_document, name)


value = st.one_of(st.floats(), st.integers(-(10**400), 10**400), st.booleans(), st.none(), st.text(max_size=3))
quantity = st.sampled_from([*region_document.QUANTITIES, "X", "r", "", None, 3])
bad_leaf = st.fixed_dictionaries(
    {"quantity": quantity, "op": st.sampled_from([*region_document.OPERATORS, "==", None]), "value": value},
    optional={"divided_by": st.sampled_from(["x", "range", "w", None]), "extra": st.just(1)},
)
metres = st.floats(-99, 99)
good_leaf = st.fixed_dictionaries(
    {"quantity": st.sampled_from(region_document.QUANTITIES), "op": st.just(">"), "value": metres},
    optional={"divided_by": st.sampled_from([*region_document.QUANTITIES, None])},
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
tree = st.recursive(
    st.one_of(good_leaf, good_leaf, good_leaf, bad_leaf, box, polygon),
    lambda node: st.one_of(
        st.lists(node, max_size=4).map(lambda nodes: {"and": nodes}),
        st.lists(node, max_size=4).map(lambda nodes: {"or": nodes}),
        node.map(lambda child: {"not": child}),
    ),
    max_leaves=12,
)


@settings(max_examples=400, deadline=None)
@given(tree)
def test_both_sides_take_and_refuse_the_same_regions_in_the_same_words(document):
    taken, wrong = service_says(document)
    assert (taken, wrong) == worker_says(document)
    if taken is not None:
        assert worker_says(json.loads(json.dumps(taken))) == (taken, None)


@pytest.mark.parametrize("depth", [1, 15, 16, 17, 40])
def test_both_sides_refuse_the_same_depth(depth):
    document = {"quantity": "x", "op": ">", "value": 0}
    for level in range(depth - 1):
        document = {"not": document} if level % 2 else {"and": [document]}
    assert service_says(document) == worker_says(document)
    assert (service_says(document)[1] is None) == (depth <= 16)


@pytest.mark.parametrize("leaves", [254, 255, 256, 300])
def test_both_sides_refuse_the_same_size(leaves):
    document = {"or": [{"quantity": "x", "op": ">", "value": 0}] * leaves}
    assert service_says(document) == worker_says(document)
    assert (service_says(document)[1] is None) == (leaves <= 255)


@pytest.mark.parametrize("corners", [2, 3, 64, 65])
def test_both_sides_refuse_the_same_number_of_corners(corners):
    document = {"polygon": [[i, i * i] for i in range(corners)]}
    assert service_says(document) == worker_says(document)
    assert (service_says(document)[1] is None) == (3 <= corners <= 64)


@pytest.mark.parametrize(
    "document",
    [
        {"and": {"quantity": "x"}},
        {"and": "abc"},
        {"and": [], "or": []},
        {"quantity": "x"},
        {},
        {"not": []},
        {"not": {"quantity": "x", "op": ">", "value": 0}, "op": ">"},
        {"box": [1, 2]},
        {"box": {"min": [0, 0, 0]}},
        {"box": {"min": [0, 0, 2e6], "max": [1, 1, 3e6]}},
        {"box": {"min": [0, 0, 0], "max": [1, 0, 1]}},
        {"polygon": [[0, 0], [1, 0], [1, 1]], "z": [1, 0]},
        {"polygon": [[0, 0], [1, 0], {"x": 1}]},
    ],
)
def test_both_sides_refuse_what_is_no_region_in_the_same_words(document):
    assert service_says(document) == worker_says(document)
    assert service_says(document)[0] is None


@pytest.mark.parametrize("document", [[], "x > 0", None, 7])
def test_both_sides_refuse_what_is_no_object(document):
    assert service_says(document)[0] is None
    assert worker_says(document)[0] is None


def test_a_very_deep_region_is_refused_without_recursion():
    document = {"quantity": "x", "op": ">", "value": 0}
    for _ in range(20_000):
        document = {"and": [document]}
    with pytest.raises(ValidationError, match="deeper than 16 levels"):
        REGION.validate_python(document)
