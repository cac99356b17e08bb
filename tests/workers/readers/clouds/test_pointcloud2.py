import numpy as np
import pytest
from making_recordings import PLAIN, START_NS, cloud, scene

from workers.readers.clouds.pointcloud2 import cloud_columns
from workers.readers.recording import ReadError

SHUFFLED = {"time": "f8", "ring": "u1", "z": "f8", "intensity": "u2", "y": "f4", "x": "f8"}


@pytest.mark.parametrize("fields", [PLAIN, SHUFFLED])
@pytest.mark.parametrize("how", [{}, {"padding": 5}, {"gap": 3}, {"big_endian": True}])
@pytest.mark.parametrize("rows", [{}, {"height": 16}, {"height": 16, "row_padding": 7}])
def test_any_layout_gives_the_same_columns(fields, how, rows):
    columns = cloud_columns(cloud(START_NS, scene(), fields, **how, **rows), "cloud")
    assert list(columns) == list(fields)
    for name, values in columns.items():
        np.testing.assert_array_equal(values.astype(fields[name]), scene()[name].astype(fields[name]))


def test_a_row_step_of_zero_in_a_cloud_of_one_row():
    message = cloud(START_NS, scene())
    message.row_step = 0
    assert len(cloud_columns(message, "cloud")["x"]) == len(scene()["x"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 2_000}, "do not hold"),
        ({"point_step": 20}, "does not fit in 20 bytes"),
        ({"point_step": 0}, "does not fit in 0 bytes"),
        ({"width": 60_000, "height": 60_000}, "claims 60000 x 60000 points"),
        ({"height": 2, "row_step": 0}, "do not hold"),
        ({"fields": []}, "have no fields"),
    ],
)
def test_sizes_that_contradict_each_other(change, said):
    message = cloud(START_NS, scene())
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ReadError, match=said) as caught:
        cloud_columns(message, "The message on /points")
    assert caught.value.code == "cloud_malformed"


def test_a_field_named_twice():
    message = cloud(START_NS, scene())
    message.fields[1].name = "x"
    with pytest.raises(ReadError, match="twice"):
        cloud_columns(message, "cloud")
