"""The board must be seen where the truth says it is."""

import cv2
import numpy as np
import pytest

from workers.simulation.background import paint_background
from workers.simulation.camera import LENSES, make_camera
from workers.simulation.render import Renderer, encode_jpeg
from workers.simulation.scene import Scene
from workers.simulation.walker import Walk

_BORDER_BGR = np.array([24.0, 150.0, 250.0])  # the frame of the board, which its apex belongs to


def seen_apex(image, background, near):
    """The apex where two lines through the board's upper edges meet.

    In each row below the apex the covered width left and right of the middle is summed over the pixels'
    coverage, which needs no threshold: coverage is how far a pixel went from background to board.
    """
    middle = round(float(near[0]))
    rows = np.arange(round(float(near[1])) + 2, round(float(near[1])) + 8)
    before = background[rows].astype(float)
    towards = _BORDER_BGR - before
    covered = ((image[rows].astype(float) - before) * towards).sum(axis=2) / (towards**2).sum(axis=2)
    reach = 24
    left = middle + 0.5 - covered[:, middle - reach : middle + 1].sum(axis=1)
    right = middle + 0.5 + covered[:, middle + 1 : middle + reach].sum(axis=1)
    slope_left, start_left = np.polyfit(rows, left, 1)
    slope_right, start_right = np.polyfit(rows, right, 1)
    v = (start_right - start_left) / (slope_left - slope_right)
    return np.array([slope_left * v + start_left, v])


@pytest.mark.parametrize(
    "model",
    [*list(LENSES)[-2:], *(pytest.param(model, marks=pytest.mark.slow) for model in list(LENSES)[:-2])],
)
def test_the_painted_apex_is_the_true_one_to_a_fraction_of_a_pixel(model):
    scene, camera = Scene(), make_camera(model, seed=2)
    background = paint_background(camera, scene, seed=2)
    renderer = Renderer(camera, scene, background)
    poses = Walk(2, 40.0, scene.ground_z).poses(np.arange(0.0, 40.0, 2.0))
    truth = camera.project(poses.apex)
    raw, coded = [], []
    for index, pixel in enumerate(truth):
        if not (40 < pixel[0] < 920 and 20 < pixel[1] < 560):
            continue
        image = renderer.frame(poses, index)
        again = cv2.imdecode(np.frombuffer(encode_jpeg(image), np.uint8), cv2.IMREAD_COLOR)
        raw.append(seen_apex(image, background, pixel) - pixel)
        coded.append(seen_apex(again, background, pixel) - pixel)
    assert len(raw) >= 12
    assert np.abs(raw).max() < 0.25
    assert np.abs(np.mean(raw, axis=0)).max() < 0.1
    assert np.abs(coded).max() < 0.5
