import numpy as np
import pytest

from apexcal.documents.errors import InputError
from tests.workers.vertices.walks import SIGMA, START_NS, seconds, spherical, vertices, walk
from workers.vertices.tracks import MARGIN_SWEEPS, Track
from workers.vertices.vertex import Vertex

MS = 1_000_000


def between(found, random, most_ms=33):
    """Moments at most ``most_ms`` from each vertex, and the vertices' numbers."""
    return np.array([v.time_ns for v in found]) + random.integers(-most_ms * MS, most_ms * MS, len(found))


def errors(plan, seeds, **kinds):
    """(N, 3) errors of the track half a frame beside its vertices, (N, 3) the same by what it states, of velocity."""
    away, scored, speed = [], [], []
    for seed in seeds:
        way = walk(seed, plan=plan)
        found = vertices(way, seed, **kinds)
        times = between(found, np.random.default_rng(seed))
        points = Track.of(found).at(times, np.arange(len(found)))
        at = seconds(times)
        error = spherical(points.xyz) - spherical(way.poses(at).apex)
        away.append(error)
        scored.append(error / np.sqrt(np.einsum("mii->mi", points.covariance)))
        true_velocity = (way.poses(at + 0.01).apex - way.poses(at - 0.01).apex) / 0.02
        speed.append(points.velocity - true_velocity)
    return np.concatenate(away), np.concatenate(scored), np.concatenate(speed)


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


def is_honest(scored):
    """Errors in units of what was stated: about 1 in all, and on no axis far from it."""
    return 0.8 < np.sqrt(np.mean(scored**2)) < 1.2 and rms(scored).min() > 0.7 and rms(scored).max() < 1.2


@pytest.mark.parametrize("plan", ["field", "rows", "slow"])
def test_the_track_is_better_than_its_vertices_and_says_how_good_it_is(plan):
    away, scored, speed = errors(plan, range(4))
    assert (rms(away) < 0.95 * SIGMA).all()
    assert (rms(away)[[0, 2]] < (0.75 * SIGMA[0], 0.5 * SIGMA[2])).all()
    assert is_honest(scored)
    assert (rms(speed) < 0.08).all()


def test_few_vertices_are_told_with_more_doubt():
    _, scored, _ = errors("field", range(4), share=0.15)
    assert is_honest(scored)


def test_a_wrong_vertex_does_not_pull_the_track():
    away, scored, _ = errors("field", range(4), wrong=0.03)
    assert (rms(away) < 1.0 * SIGMA).all()
    assert (rms(scored) < 1.2).all()


def test_a_single_vertex_is_moved_nowhere_and_says_how_far_a_person_walks():
    alone = Vertex((10.0, 1.0, 0.2), START_NS, 5, 40, 1, "strict")
    here, later = (Track.of([alone]).at([START_NS + gap]) for gap in (0, 50 * MS))
    assert here.xyz[0] == pytest.approx(alone.xyz, abs=1e-6)
    assert later.xyz[0] == pytest.approx(alone.xyz, abs=1e-6)
    assert later.gap_ns.tolist() == [50 * MS]
    before, after = (np.sqrt(np.diagonal(points.covariance_xyz[0])) for points in (here, later))
    assert after[0] == pytest.approx(np.hypot(before[0], 0.05 * 1.2), rel=0.05)
    # The rule of the top ring is low by a tenth of a degree, which no neighbour would tell.
    assert np.degrees(np.sqrt(here.covariance[0, 1, 1])) == pytest.approx(np.hypot(0.1, 0.045), rel=0.01)


def test_the_error_that_strict_vertices_share_is_not_averaged_away():
    way = walk(3, plan="slow")
    found = vertices(way, 3, sigma=np.array([np.radians(0.047), np.radians(0.045), 0.008]), stated=False)
    times = [v.time_ns for v in found]
    points = Track.of(found).at(times)
    elevation = np.degrees(np.sqrt(points.covariance[:, 1, 1]))
    assert (elevation > 0.099).all()
    assert np.median(np.degrees(np.sqrt(points.covariance[:, 0, 0]))) < 0.03


def test_what_lies_beyond_the_window_changes_nothing():
    found = vertices(walk(1), 1)
    middle = found[len(found) // 2]
    near = [v for v in found if abs(v.sweep_index - middle.sweep_index) <= MARGIN_SWEEPS]
    assert len(near) < len(found)
    everything, some = Track.of(found), Track.of(near)
    moment = [middle.time_ns + 21 * MS]
    whole = everything.at(moment, everything.places([middle]))
    part = some.at(moment, some.places([middle]))
    np.testing.assert_allclose(part.xyz, whole.xyz, rtol=0, atol=1e-9)
    np.testing.assert_allclose(part.covariance, whole.covariance, rtol=1e-6)


def test_the_order_of_the_vertices_does_not_matter():
    found = vertices(walk(2), 2)
    times = between(found, np.random.default_rng(0))
    np.testing.assert_array_equal(Track.of(found[::-1]).at(times).xyz, Track.of(found).at(times).xyz)


def test_no_moments_and_no_vertices():
    assert Track.of(vertices(walk(1), 1)).at([]).covariance.shape == (0, 3, 3)
    with pytest.raises(InputError) as caught:
        Track.of([]).at([START_NS])
    assert caught.value.code == "track_empty"
