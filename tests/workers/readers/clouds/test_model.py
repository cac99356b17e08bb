import numpy as np
import pytest
from making_recordings import START_NS, scattered, scene

from workers.readers.clouds.model import learn_clouds
from workers.readers.recording import ReadError, ReadOptions


def learn(columns):
    return learn_clouds([(START_NS, columns)], 100_000_000, ReadOptions(), "/points")


def test_points_without_a_return_are_dropped_from_every_column():
    columns = scene()
    columns["x"] = columns["x"].copy()
    columns["x"][3] = np.nan
    columns["z"] = columns["z"].copy()
    columns["z"][5] = np.inf
    for axis in "xyz":
        columns[axis] = columns[axis].copy()
        columns[axis][7] = 0
    sweep = learn(columns).sweep(START_NS, columns)
    kept = np.delete(np.arange(len(columns["x"])), [3, 5, 7])
    np.testing.assert_array_equal(sweep.xyz[:, 1], columns["y"][kept].astype(np.float32))
    np.testing.assert_array_equal(sweep.ring, columns["ring"][kept])
    np.testing.assert_array_equal(sweep.intensity, columns["intensity"][kept])
    np.testing.assert_allclose(sweep.offset_ns, columns["time"][kept] * 1e9, atol=1)
    types = [sweep.xyz.dtype, sweep.intensity.dtype, sweep.ring.dtype, sweep.offset_ns.dtype]
    assert types == [np.float32, np.float32, np.uint16, np.int64]


def test_no_ring_field():
    columns = {name: values for name, values in scene().items() if name != "ring"}
    model = learn(columns)
    assert model.facts.ring_count == 16 and any("VLP-16" in note for note in model.facts.notes)
    between = {name: values.copy() for name, values in columns.items()}
    between["z"][5] = 0.0
    sweep = model.sweep(0, between)
    np.testing.assert_array_equal(sweep.ring, np.delete(scene()["ring"], 5))
    np.testing.assert_array_equal(sweep.intensity, np.delete(columns["intensity"], 5).astype(np.float32))
    assert "1 points were left out, because they lie between" in model.warnings()[0]


def test_no_ring_field_and_no_rings():
    with pytest.raises(ReadError) as caught:
        learn(scattered())
    assert caught.value.code == "rings_not_separable" and "PointXYZIR" in caught.value.hint


def test_no_coordinates():
    with pytest.raises(ReadError) as caught:
        learn({"ring": np.zeros(3), "range": np.zeros(3)})
    assert caught.value.code == "cloud_without_xyz"


def test_ouster_names_and_order():
    columns = scene()
    turned = {axis: columns[axis] for axis in "xyz"} | {
        "reflectivity": columns["intensity"],
        "t": np.rint(columns["time"] * 1e9).astype(np.uint32),
        "channel": (15 - columns["ring"]).astype(np.uint8),
    }
    model = learn(turned)
    sweep = model.sweep(START_NS, turned)
    np.testing.assert_array_equal(sweep.ring, columns["ring"])
    np.testing.assert_array_equal(sweep.intensity, columns["intensity"])
    assert (model.facts.time_source, model.facts.ring_count) == ("per_point", 16)


def test_a_cloud_without_intensity_says_so():
    columns = {name: values for name, values in scene().items() if name != "intensity"}
    model = learn(columns)
    assert not model.sweep(START_NS, columns).intensity.any()
    assert any("no intensity" in note for note in model.facts.notes)


def test_ring_ids_that_no_sample_had_are_left_out_and_counted():
    model = learn(scene())
    columns = scene()
    columns["ring"] = columns["ring"].copy()
    columns["ring"][:2] = 999
    sweep = model.sweep(START_NS, columns)
    assert len(sweep.xyz) == len(columns["x"]) - 2
    np.testing.assert_array_equal(sweep.intensity, columns["intensity"][2:])
    assert "2 points were left out" in model.warnings()[0]


def test_an_empty_sweep_is_a_sweep():
    model = learn(scene())
    sweep = model.sweep(START_NS, {name: values[:0] for name, values in scene().items()})
    assert sweep.xyz.shape == (0, 3) and sweep.offset_ns.shape == (0,)
    derived = learn({name: values for name, values in scene().items() if name != "time"})
    assert derived.sweep(START_NS, {name: values[:0] for name, values in scene().items()}).ring.shape == (0,)


def test_a_dense_cloud_is_learned_from_a_part_of_it():
    columns = scene(rings=128, columns=400)
    model = learn(columns)
    assert model.facts.ring_count == 128 and model.facts.time_source == "per_point"
    np.testing.assert_array_equal(model.sweep(START_NS, columns).ring, columns["ring"])


@pytest.mark.parametrize("field", ["x", "ring", "intensity", "time"])
def test_a_cloud_that_lacks_what_the_first_one_has(field):
    columns = scene()
    other = {name: values for name, values in columns.items() if name != field}
    for look in (
        lambda: learn(columns).sweep(START_NS, other),
        lambda: learn_clouds([(START_NS, columns), (START_NS, other)], None, ReadOptions(), "/points"),
    ):
        with pytest.raises(ReadError) as caught:
            look()
        assert caught.value.code == "cloud_fields_differ" and f"no {field}, which" in caught.value.message
