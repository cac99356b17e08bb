"""What a worker's parent compiles before it forks."""

import pytest

from tests.support.side_by_side import LONG_S
from workers.solver import correlation
from workers.tasks.warming import _REGION, _SWEEPS, _sweep, warm_up
from workers.vertices import range_image
from workers.vertices.board import outline, planes, posterior, rays, surroundings
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

KERNELS = (
    outline.on_board_probability,
    surroundings.angles_of_point,
    posterior.find_corner,
    planes.find_segments,
    planes.pair_segments,
    planes.fit_plane,
    planes.grow_planes,
    rays.likelihood_ratios,
    rays.follow_board,
    rays.choose_rays,
    rays.mixed_rays,
    range_image._image,
    correlation._product,
    correlation._normal_equations,
    correlation._unlikely,
)


@pytest.mark.timeout(LONG_S)
def test_every_kernel_has_its_machine_code_afterwards():
    warm_up()
    assert [kernel.__name__ for kernel in KERNELS if not kernel.signatures] == []


def test_the_board_that_it_shows_them_is_found():
    sweeps = Listed([_sweep(number) for number in range(_SWEEPS)])
    found = detect_range(sweeps, Region.from_document(_REGION), "refined", indices=range(_SWEEPS))
    assert len(found.vertices) >= _SWEEPS // 2, found.rejected
