import pytest

from apexcal.documents.checks import figure


@pytest.mark.parametrize(
    ("value", "text"), [(54.3, "54"), (112.0, "110"), (123456.0, "120000"), (0.00123, "0.0012"), (1.2e-5, "0.000012"),
                        (0.0, "0"), (1.0, "1"), (-2.55, "-2.5")],
)  # fmt: skip
def test_a_figure_has_two_digits_and_no_exponent(value, text):
    assert figure(value) == text


def test_a_figure_may_have_more_digits():
    assert figure(123456.0, 3) == "123000"
