"""Terms of the refined detector's covariances, each beside its formula, and the flag of a second board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.detectors import resolve_options
from tests.workers.vertices.refined_walks import REGION, SIZE, walk
from workers.geometry.spherical import to_xyz
from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import PosteriorMode
from workers.vertices.board.estimate import estimate_board, find_boards
from workers.vertices.board.learning import learn
from workers.vertices.board.model import EDGE_M
from workers.vertices.corners import corners_of
from workers.vertices.detectors import detect_range, without_fixed
from workers.vertices.sweep_source import Listed


@pytest.fixture(scope="module")
def boards():
    """The model that a walk teaches, and the likeliest board of some of its sweeps."""
    recorded = walk(27, 8.0)
    area = without_fixed(recorded.source, REGION)
    model = learn(recorded.source, area, resolve_options("refined", SIZE), lambda: None)
    sweeps = [recorded.source.sweep(index) for index in range(5, 80, 12)]
    found = [find_boards(sweep, area.inside(sweep), model) for sweep in sweeps]
    return model, [boards[0][1] for boards in found if boards]


def test_edges_that_bloom_raise_the_tip_by_the_root_of_two(boards):
    """Both upper edges move out by g radians, so the tip, a right angle, rises by sqrt(2) g."""
    model, estimates = boards
    sigma = 2e-3
    for board in estimates:
        sharp = estimate_board(board.plane, replace(model, blooming_sigma=0.0))
        blooming = estimate_board(board.plane, replace(model, blooming_sigma=sigma))
        more = blooming.covariance - sharp.covariance
        assert more[1, 1] == pytest.approx(2.0 * sigma**2, rel=0.05)
        # Straight up: azimuth hardly moves. Range follows the plane's lean.
        assert abs(more[0, 0]) < 0.05 * more[1, 1]
        assert np.linalg.matrix_rank(more / np.abs(more).max(), tol=1e-6) == 1


def test_edges_that_are_not_straight_and_beams_that_are_wide_move_the_tip(boards):
    """Across the ray the tip has a floor: a panel's cut, 3.5 mm, and a beam's width of 9.5 mm, even over it."""
    model, estimates = boards
    for board in estimates:
        located = estimate_board(board.plane, replace(model, blooming_sigma=0.0))
        floor = np.trace(located.covariance[:2, :2]) - located.sigma**2
        distance = np.linalg.norm(located.xyz)
        azimuth_by_metre = 1.0 / np.hypot(*located.xyz[:2])
        across = (0.0035**2 + 0.0095**2 / 12.0) * (azimuth_by_metre**2 + distance**-2)
        # A plane that is turned away has its metres shorter across the ray.
        assert 0.8 * across < floor < 1.02 * across


def test_what_rings_have_in_common_is_part_of_the_range(boards):
    model, estimates = boards
    for board in estimates:
        none, some = (estimate_board(board.plane, replace(model, bias=bias)).covariance for bias in (0.01, 0.02))
        assert some[2, 2] - none[2, 2] == pytest.approx(0.02**2 - 0.01**2, rel=1e-6)


def test_the_lengths_of_the_edges_are_part_of_the_corners_errors(boards):
    """If tip, roll and plane are exact, a side corner errs along its edge by what the edge's length errs."""
    for board in boards[1]:
        mode = board.hold.modes[0]
        exact = replace(
            board,
            plane=replace(board.plane, covariance=np.zeros((3, 3)), ring_covariance=np.zeros((3, 3))),
            hold=replace(board.hold, modes=(PosteriorMode(1.0, mode.edges, mode.mean, np.zeros((3, 3))),)),
        )
        corners = corners_of(exact, 1.0)
        assert list(corners.names) == ["left", "right", "bottom"]
        places = np.array([board.xyz, *corners.xyz])
        joint = np.array(corners.covariance).reshape(4, 3, 4, 3)
        to_metres = np.array([_metres_by_angles(place) for place in places])
        joint = np.einsum("iab,ibjc,jdc->iajd", to_metres, joint, to_metres)
        for corner in (1, 2):
            apart = joint[corner, :, corner] + joint[0, :, 0] - joint[corner, :, 0] - joint[0, :, corner]
            edge = places[corner] - places[0]
            along = edge / np.linalg.norm(edge)
            assert np.sqrt(along @ apart @ along) == pytest.approx(EDGE_M, rel=0.03)
            # Both upper edges tell the roll, each end of them to EDGE_M. It moves a side corner across its edge.
            w = exact.plane.R_window_lidar.T @ exact.plane.w
            across = np.cross(w / np.linalg.norm(w), along)
            roll = EDGE_M * np.sqrt(0.5 * (mode.edges[0] ** -2 + mode.edges[1] ** -2))
            assert np.sqrt(across @ apart @ across) == pytest.approx(roll * np.linalg.norm(edge), rel=0.03)


def _metres_by_angles(xyz):
    """(3, 3) derivative of x, y, z by azimuth, elevation and range."""
    return np.column_stack([_root(xyz, unit) for unit in np.eye(3)])


def _root(xyz, unit):
    # A covariance of rank one is mapped to that of the column; the sign is told by the place itself.
    x, y, z = xyz
    flat = np.hypot(x, y)
    columns = np.array([[-y, x, 0.0], [-x * z / flat, -y * z / flat, flat], xyz / np.linalg.norm(xyz)])
    column = unit @ columns
    np.testing.assert_allclose(to_xyz(np.outer(unit, unit)[None], xyz[None])[0], np.outer(column, column), atol=1e-9)
    return column


def test_a_second_board_is_flagged_in_the_sweep_that_shows_it():
    """In one sweep the board's sector is shown a second time, turned about the sensor onto free ground."""
    recorded = walk(27, 20.0)
    plain = detect_range(recorded.source, REGION, "refined", SIZE, indices=range(60, 76)).vertices
    assert not any("second_board" in vertex.flags for vertex in plain)
    index = next(one.sweep_index for one in plain if np.linalg.norm(one.xyz) < 9.0 and not one.flags)
    sweeps = list(recorded.sweeps)
    sweeps[index] = _shown_twice(sweeps[index], recorded.apex[index])
    found = detect_range(Listed(sweeps), REGION, "refined", SIZE, indices=range(60, 76)).vertices
    assert [one.sweep_index for one in found if "second_board" in one.flags] == [index]


def _shown_twice(sweep: Sweep, apex: np.ndarray) -> Sweep:
    """The sweep with the returns around the apex once more, turned towards the middle, in place of those there."""
    azimuth = np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0])
    at, reach = np.arctan2(apex[1], apex[0]), 0.9 / np.hypot(apex[0], apex[1])
    turn = -np.sign(at) * 3.2 * reach
    copied, free = np.abs(azimuth - at) < reach, np.abs(azimuth - at - turn) >= reach
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y, z = sweep.xyz[copied].T
    twin = np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z]).astype(np.float32)
    step = round(float(turn) / (2.0 * np.pi) * 1e8)

    def both(name: str, there: np.ndarray) -> np.ndarray:
        return np.concatenate([getattr(sweep, name)[free], there])

    order = np.argsort(both("offset_ns", sweep.offset_ns[copied] - step), kind="stable")
    return replace(
        sweep,
        xyz=both("xyz", twin)[order],
        intensity=both("intensity", sweep.intensity[copied])[order],
        ring=both("ring", sweep.ring[copied])[order],
        offset_ns=both("offset_ns", sweep.offset_ns[copied] - step)[order],
    )
