"""Corners measured from edges, on painted corners whose truth is sub-pixel."""

import cv2
import numpy as np
import pytest

from workers.marks.edges import CornerFit, measure_corner

OVERSAMPLE = 8


def painted(corner, angles_deg, contrast=60.0, blur=0.8, noise=1.0, seed=0, size=(240, 200), texture=0.0):
    """A wedge whose corner and edges are exact to a hundredth of a pixel; angles of both edges, clockwise from u."""
    random = np.random.default_rng(seed)
    canvas = np.zeros((size[1] * OVERSAMPLE, size[0] * OVERSAMPLE), np.float32)
    ends = [np.array(corner) + 400.0 * np.array([np.cos(a), np.sin(a)]) for a in np.radians(angles_deg)]
    outline = (np.array([corner, ends[0], ends[1]]) + 0.5) * OVERSAMPLE - 0.5
    cv2.fillPoly(canvas, [np.round(outline * 16).astype(np.int32)], 1.0, lineType=cv2.LINE_8, shift=4)
    cover = cv2.resize(canvas, size, interpolation=cv2.INTER_AREA)
    image = 110.0 + contrast * cv2.GaussianBlur(cover, (0, 0), blur)
    grain = random.normal(0.0, texture, (size[1] // 4, size[0] // 4)).astype(np.float32)
    return image + (1.0 - cover) * cv2.resize(grain, size) + random.normal(0.0, noise, image.shape)


def edges_of(corner, angles_deg, length=120.0):
    ways = [np.array([np.cos(a), np.sin(a)]) for a in np.radians(angles_deg)]
    return tuple(lambda share, way=way: np.array(corner) + length * share[:, None] * way for way in ways)


@pytest.mark.parametrize(
    ("contrast", "blur", "dtype"),
    [(60.0, 0.5, np.uint8), (-40.0, 2.0, np.uint8), (25.0, 1.0, np.uint8), (60.0, 1.0, np.uint16)],
)
def test_the_corner_is_exact_from_a_projection_some_pixels_off(contrast, blur, dtype):
    truth, angles = (118.37, 61.81), (38.0, 142.0)
    image = painted(truth, angles, contrast, blur)
    if dtype is np.uint16:
        image = 7000.0 + 5.0 * image
    fit = measure_corner(np.rint(image).astype(dtype), edges_of((122.4, 57.0), (41.0, 140.0)))
    assert isinstance(fit, CornerFit)
    off = fit.pixel - truth
    assert np.hypot(*off) < 0.2
    assert np.hypot(*off) < 5.0 * np.sqrt(np.trace(fit.covariance)) + 0.1
    assert abs(fit.softness_px - np.hypot(blur, 0.29)) < 0.5


def test_the_stated_deviation_grows_with_the_noise():
    truth, angles = (118.37, 61.81), (40.0, 140.0)
    sigmas = []
    for noise in (0.5, 6.0):
        fit = measure_corner(
            np.rint(painted(truth, angles, 60.0, 1.0, noise)).astype(np.uint8), edges_of(truth, angles)
        )
        assert isinstance(fit, CornerFit)
        sigmas.append(float(np.sqrt(np.trace(fit.covariance))))
    assert sigmas[1] > 3.0 * sigmas[0]


def test_the_stated_deviation_grows_as_the_corner_lies_farther_outside_of_the_image():
    """What shifts an edge may turn it too: so it counts the more, the farther the edges are continued."""
    growths = []
    for above in (-80.0, 10.0, 30.0, 60.0):
        corner = (120.0, -above)
        fit = measure_corner(painted(corner, (60.0, 120.0)), edges_of(corner, (60.0, 120.0), 180.0))
        assert isinstance(fit, CornerFit)
        growths.append(float(np.sqrt(np.trace(fit.extrapolation))))
    assert growths[0] == 0.0 and growths == sorted(growths) and growths[-1] > 2.0


def test_a_lens_that_bends_the_edges_moves_nothing():
    truth = np.array([118.37, 61.81])
    image = painted(truth, (40.0, 140.0))
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float32)

    def bent(u, v):
        return v + 3e-4 * (u - truth[0]) ** 2

    warped = cv2.remap(
        image.astype(np.float32),
        columns,
        rows - np.float32(3e-4) * (columns - np.float32(truth[0])) ** 2,
        cv2.INTER_CUBIC,
    )
    straight = edges_of(truth + np.array((3.0, -3.0)), (40.0, 140.0))
    curves = tuple(
        lambda share, edge=edge: np.column_stack([edge(share)[:, 0], bent(*edge(share).T)]) for edge in straight
    )
    fit = measure_corner(np.clip(np.rint(warped), 0, 255).astype(np.uint8), curves)
    assert isinstance(fit, CornerFit)
    assert np.hypot(*(fit.pixel - truth)) < 0.25


def test_texture_alone_is_no_corner():
    random = np.random.default_rng(5)
    accepted = 0
    for _ in range(60):
        image = 110.0 + cv2.resize(random.normal(0.0, 20.0, (50, 60)).astype(np.float32), (240, 200))
        image += random.normal(0.0, 1.5, image.shape).astype(np.float32)
        fit = measure_corner(np.clip(image, 0, 255).astype(np.uint8), edges_of((120.0, 60.0), (40.0, 140.0)))
        accepted += isinstance(fit, CornerFit)
    assert accepted <= 3


def test_refusals_are_named():
    image = np.rint(painted((118.0, 62.0), (40.0, 140.0))).astype(np.uint8)
    assert measure_corner(image, edges_of((-50.0, -80.0), (215.0, 325.0))) == "outside"
    assert measure_corner(image, edges_of((118.0, 62.0), (40.0, 140.0), length=12.0)) == "few_pixels"
    assert measure_corner(image, edges_of((60.0, 150.0), (100.0, 200.0))) in ("no_edge", "outside")
