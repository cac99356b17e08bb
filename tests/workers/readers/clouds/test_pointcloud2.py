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


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 2_000}, "do not hold"),
        ({"point_step": 20}, "does not fit in 20 bytes"),
        ({"point_step": 0}, "does not fit in 0 bytes"),
        ({"width": 60_000, "height": 60_000}, "claims 60000 x 60000 points"),
        ({"height": 2, "row_step": 0}, "do not hold"),
        ({"fields": []}, "have no fields"),
        ({"fields": cloud(START_NS, scene()).fields[:1] * 2}, "twice"),
    ],
)
def test_sizes_that_contradict_each_other(change, said):
    message = cloud(START_NS, scene())
    message.row_step = 0  # of one row it need not be stated
    assert len(cloud_columns(message, "cloud")["x"]) == len(scene()["x"])
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ReadError, match=said) as caught:
        cloud_columns(message, "The message on /points")
    assert caught.value.code == "cloud_malformed"
