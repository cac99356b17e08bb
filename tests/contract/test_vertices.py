"""Service and workers speak of regions and detectors in the same words."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from service.detections import detectors, regions
from workers.vertices import detectors as worker_detectors
from workers.vertices import region as worker_region

REGION = TypeAdapter(regions.Region)


def service_takes(document):
    try:
        return REGION.validate_python(document)
    except ValidationError:
        return None


def worker_takes(document):
    try:
        worker_region.Region.from_document(document)
    except worker_region.RegionError:
        return False
    return True


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


def test_quantities_operators_and_limits_are_the_same():
    leaf = regions.Leaf.model_json_schema()["properties"]
    assert tuple(leaf["quantity"]["enum"]) == worker_region.QUANTITIES
    assert tuple(leaf["op"]["enum"]) == worker_region.OPERATORS
    assert (regions.MAX_DEPTH, regions.MAX_NODES) == (worker_region.MAX_DEPTH, worker_region.MAX_NODES)


value = st.one_of(st.floats(), st.integers(-(10**400), 10**400), st.booleans(), st.none(), st.text(max_size=3))
quantity = st.sampled_from([*worker_region.QUANTITIES, "X", "r", "", None, 3])
leaf = st.fixed_dictionaries(
    {"quantity": quantity, "op": st.sampled_from([*worker_region.OPERATORS, "==", None]), "value": value},
    optional={"divided_by": st.sampled_from(["x", "range", "w"]), "extra": st.just(1)},
)
good_leaf = st.fixed_dictionaries(
    {"quantity": st.sampled_from(worker_region.QUANTITIES), "op": st.just(">"), "value": st.floats(-99, 99)},
    optional={"divided_by": st.sampled_from(worker_region.QUANTITIES)},
)
tree = st.recursive(
    st.one_of(good_leaf, good_leaf, good_leaf, leaf),
    lambda node: st.one_of(
        st.lists(node, max_size=4).map(lambda nodes: {"and": nodes}),
        st.lists(node, max_size=4).map(lambda nodes: {"or": nodes}),
    ),
    max_leaves=12,
)


@settings(max_examples=400, deadline=None)
@given(tree)
def test_both_sides_take_and_refuse_the_same_regions(document):
    taken = service_takes(document)
    assert (taken is not None) == worker_takes(document)
    if taken is not None:
        assert worker_takes(json.loads(json.dumps(taken)))


@pytest.mark.parametrize("depth", [1, 15, 16, 17, 40])
def test_both_sides_refuse_the_same_depth(depth):
    document = {"quantity": "x", "op": ">", "value": 0}
    for _ in range(depth - 1):
        document = {"and": [document]}
    assert (service_takes(document) is not None) == worker_takes(document) == (depth <= 16)


@pytest.mark.parametrize("leaves", [254, 255, 256, 300])
def test_both_sides_refuse_the_same_size(leaves):
    document = {"or": [{"quantity": "x", "op": ">", "value": 0}] * leaves}
    assert (service_takes(document) is not None) == worker_takes(document) == (leaves <= 255)


@pytest.mark.parametrize(
    "document",
    [[], "x > 0", None, {"and": {"quantity": "x"}}, {"and": "abc"}, {"and": [], "or": []}, {"quantity": "x"}, {}],
)
def test_both_sides_refuse_what_is_no_tree(document):
    assert service_takes(document) is None
    assert not worker_takes(document)


def test_a_very_deep_region_is_refused_without_recursion():
    document = {"quantity": "x", "op": ">", "value": 0}
    for _ in range(20_000):
        document = {"and": [document]}
    with pytest.raises(ValidationError, match="deeper than 16 levels"):
        REGION.validate_python(document)
