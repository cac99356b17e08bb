import numpy as np
import pytest
from making_recordings import START_NS, scene

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.model import learn_clouds
from workers.readers.recording import MessageError


def learn(*clouds, period_ns=100_000_000):
    return learn_clouds([(START_NS, columns) for columns in clouds], period_ns, ReadOptions(), "/points")


def without(*names):
    return {name: values.copy() for name, values in scene().items() if name not in names}


def test_points_without_a_return_are_dropped_from_every_column():
    columns = without()
    columns["x"][3], columns["z"][5] = np.nan, np.inf
    for axis in "xyz":
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
    columns = without("ring")
    model = learn(columns)
    assert model.facts.ring_count == 16 and any("VLP-16" in note for note in model.facts.notes)
    between = without("ring")
    between["z"][5] = 0.0
    sweep = model.sweep(0, between)
    np.testing.assert_array_equal(sweep.ring, np.delete(scene()["ring"], 5))
    np.testing.assert_array_equal(sweep.intensity, np.delete(columns["intensity"], 5).astype(np.float32))
    assert "1 points were left out, because they lie between" in model.warnings()[0]


def test_a_cloud_without_intensity_says_so_and_an_empty_one_is_left_out():
    model = learn(without("intensity"))
    assert not model.sweep(START_NS, without("intensity")).intensity.any()
    assert any("no intensity" in note for note in model.facts.notes)
    for columns in (scene(), without("time")):
        for lost in (scene() | {"x": np.full(1440, np.nan)}, {name: values[:0] for name, values in scene().items()}):
            with pytest.raises(MessageError) as caught:
                learn(columns).sweep(START_NS, lost)
            assert caught.value.code == "cloud_empty"


def test_ring_ids_that_no_sample_had_are_left_out_and_counted():
    model, columns = learn(scene()), without()
    columns["ring"][:2] = 999
    sweep = model.sweep(START_NS, columns)
    assert len(sweep.xyz) == len(columns["x"]) - 2
    np.testing.assert_array_equal(sweep.intensity, columns["intensity"][2:])
    assert "2 points were left out" in model.warnings()[0]


def test_a_dense_cloud_is_learned_from_a_part_of_it():
    columns = scene(rings=128, columns=400)
    model = learn(columns)
    assert model.facts.ring_count == 128 and model.facts.time_source == "per_point"
    np.testing.assert_array_equal(model.sweep(START_NS, columns).ring, columns["ring"])


@pytest.mark.parametrize("field", ["x", "ring", "intensity", "time"])
def test_a_cloud_that_lacks_what_the_others_have(field):
    lacking = without(field)
    model = learn(lacking, scene(), scene())  # what most have is learned
    with pytest.raises(MessageError) as caught:
        model.sweep(START_NS, lacking)
    assert caught.value.code == "cloud_fields_differ" and f"no {field}, which" in caught.value.message
