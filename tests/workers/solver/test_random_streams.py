import numpy as np

from tests.workers.solver.rigs import simulated
from workers.solver.random_streams import draw, fill_normal, fill_uniform, stream_key

PROBLEM, _ = simulated("pinhole", 1)


def test_draws_are_splitmix64():
    # The generator's published first outputs for seed 0 (state 0 + golden, ...).
    expected = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    assert [int(draw(np.uint64(0), np.uint64(n))) for n in (1, 2, 3)] == expected


def test_a_stream_can_be_entered_anywhere():
    for fill, rows in ((fill_normal, (4,)), (fill_uniform, ())):
        whole, part = np.empty((*rows, 1000), dtype=np.float32), np.empty((*rows, 400), dtype=np.float32)
        fill(np.uint64(9), 0, whole)
        fill(np.uint64(9), 600, part)
        np.testing.assert_array_equal(whole[..., 600:], part)


def test_moments():
    normals = np.empty((4, 200_000), dtype=np.float32)
    fill_normal(stream_key(PROBLEM, 0, 0), 0, normals)
    np.testing.assert_allclose(normals.mean(axis=1, dtype=float), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(normals), np.eye(4), atol=0.01)
    # A sum of four uniform numbers has the fourth moment 3 - 6 / 5 / 4.
    np.testing.assert_allclose(np.mean(normals.astype(float) ** 4, axis=1), 2.7, atol=0.05)
    assert abs(np.mean(normals[:, :-1] * normals[:, 1:], dtype=float)) < 0.01
    values = np.empty(400_000, dtype=np.float32)
    fill_uniform(stream_key(PROBLEM, 0, 0), 0, values)
    assert values.min() >= 0
    assert values.max() < 1
    assert abs(values.mean(dtype=float) - 0.5) < 0.003


def test_keys_differ_in_each_part():
    keys = {int(stream_key(PROBLEM, iteration, slot)) for iteration in range(20) for slot in range(20)}
    assert len(keys) == 400
    assert stream_key(PROBLEM, 1, 11) != stream_key(PROBLEM, 11, 1)
