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


def strange(change):
    """A cloud of 16 rows whose fields of layout a driver filled in otherwise."""
    more = dict.fromkeys("abc", "f4") if "fields" in change else {}
    message = cloud(START_NS, scene() | dict.fromkeys("abc", 0.0), PLAIN | more, height=16)
    for name, value in change.items():
        if name == "counts":
            for field in message.fields:
                field.count = value
        elif name == "fields":
            x, y, z, intensity, ring, time, a, _, _ = message.fields
            a.count = value
            message.fields = [x, y, z, intensity, ring, time, a]
        else:
            setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    "change",
    [
        *({"row_step": 0}, {"row_step": 16 * 90 * 22}, {"row_step": 90}, {"row_step": 2**32 - 1}),
        *({"counts": 0}, {"counts": 1440}, {"counts": 2**32 - 1}),
        *({"width": 1440, "height": 1, "row_step": 7}, {"width": 1440, "height": 0}),
        {"width": 1, "height": 1440, "row_step": 0},
        *({"fields": 3}, {"fields": 900}),
    ],
    ids=str,
)  # fmt: skip
def test_layouts_that_say_one_thing_wrong_give_the_points(change):
    columns = cloud_columns(strange(change), "cloud")
    for name in PLAIN:
        np.testing.assert_array_equal(columns[name], scene()[name].astype(PLAIN[name]))
    if change.get("fields") == 3:  # an array of three fits before the point's end
        assert columns["a"].shape == (1440, 3)


def test_padding_that_bears_one_name_is_no_field():
    message = cloud(START_NS, scene() | {"_": 0.0}, PLAIN | {"_": "f4"})
    message.fields = [*message.fields, message.fields[-1]]
    assert set(PLAIN) < set(cloud_columns(message, "cloud"))
    message.fields[0].datatype = 9
    with pytest.raises(ReadError, match="field 'x' has the datatype 9"):
        cloud_columns(message, "cloud")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 2_000}, "do not hold"),
        ({"point_step": 20}, "does not fit in 20 bytes"),
        ({"point_step": 0}, "does not fit in 0 bytes"),
        ({"width": 60_000, "height": 60_000}, "claims 60000 x 60000 points"),
        ({"height": 2, "row_step": 0}, "do not hold .* 0 bytes from row to row .row_step"),
        ({"height": 2, "width": 700, "row_step": 17}, "17 bytes from row to row .row_step"),
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
