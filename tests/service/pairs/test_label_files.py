"""The toolbox's labels.txt: MATLAB's pixels become ours, and what is no such file is refused by its line."""

import pytest

from service.pairs.label_files import is_labels, read_labels
from service.platform.http.problems import Problem

# As the toolbox's fprintf writes it: every number with six digits.
LABELS = (
    "74.000000 98.000000 4.123456 -0.250000 0.910000 321.000000 201.000000\n"
    "75.000000 99.000000 4.200000 -0.260000 0.920000 320.000000 200.000000\n"
)


def test_pixels_count_from_zero_and_a_lidar_frame_is_a_group():
    assert is_labels(LABELS) and is_labels("\n" + LABELS)
    assert read_labels(LABELS) == {
        "x": [4.123456, 4.2], "y": [-0.25, -0.26], "z": [0.91, 0.92], "u": [320.0, 319.0], "v": [200.0, 199.0],
        "group": [74, 75],
    }  # fmt: skip


@pytest.mark.parametrize("text", ["", "x,y,z,u,v\n", "1,2,3,4,5,6,7\n", "1 2 3 4 5 6\n", "a b c d e f g\n"])
def test_what_has_not_seven_numbers_in_a_line_is_no_labels(text):
    assert not is_labels(text)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("74 98 4 0 1 320", "line 3: it has 6 numbers, not 7"),
        ("74 98 4 0 one 320 200", "line 3: 'one' is no number"),
        ("74 98 4 0 nan 320 200", "line 3: 'nan' is no number"),
        ("0 98 4 0 1 320 200", "line 3: the first two numbers must be frame numbers from 1"),
        ("74.5 98 4 0 1 320 200", "line 3: the first two numbers must be frame numbers from 1"),
        ("74 98 4123 0 1 320 200", "line 3: the corner lies 4123 m away"),
        ("74 98 4 0 1 320 0", "line 3: the mark (320, 0) lies outside of the image"),
    ],
)
def test_what_is_wrong_is_named_by_its_line(row, says):
    with pytest.raises(Problem) as refused:
        read_labels(LABELS + row)
    assert (refused.value.status, refused.value.code) == (422, "invalid_pairs") and says in refused.value.detail
