import pytest

from apexcal.documents.errors import DocumentError
from workers.geometry.models import INTRINSICS, MODELS, SEARCH_FORMS, parameter_names, parse_model


@pytest.mark.parametrize("name", MODELS)
def test_models_are_read(name):
    assert parse_model(name) == name


def test_fisheye_is_answered_with_both_models_that_people_mean():
    with pytest.raises(DocumentError) as caught:
        parse_model("fisheye")
    assert caught.value.code == "unknown_model"
    assert "kannala_brandt" in caught.value.hint
    assert "brown_conrady" in caught.value.hint


@pytest.mark.parametrize("name", ["", "Pinhole", None, 3, ["pinhole"]])
def test_other_names_are_refused(name):
    with pytest.raises(DocumentError) as caught:
        parse_model(name)
    assert caught.value.code == "unknown_model"


def test_numbers_of_parameters_are_the_papers():
    assert {model: 6 + len(names) for model, names in INTRINSICS.items()} == {
        "pinhole": 10,
        "brown_conrady": 16,
        "kannala_brandt": 14,
    }
    for model in MODELS:
        for form in SEARCH_FORMS:
            names = parameter_names(model, form)
            assert len(set(names)) == len(names)
