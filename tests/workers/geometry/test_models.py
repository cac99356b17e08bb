from workers.geometry.models import INTRINSICS, MODELS, SEARCH_FORMS, parameter_names, parse_model


def test_numbers_of_parameters_are_the_papers():
    assert [parse_model(name) for name in MODELS] == list(MODELS)
    numbers = {"pinhole": 10, "brown_conrady": 16, "kannala_brandt": 14, "rational_polynomial": 18}
    assert {model: 6 + len(names) for model, names in INTRINSICS.items()} == numbers
    for names in (parameter_names(model, form) for model in MODELS for form in SEARCH_FORMS):
        assert len(set(names)) == len(names)
