"""Seeds from a frame alone: chessboards and outlines."""

import cv2
import numpy as np
import pytest

from workers.marks.board_seeds import find_chessboard_seeds, find_outline_seeds

TURNED = {0: 45.0, 1: 0.0, -1: 90.0}
ORDER = ("top", "right", "bottom", "left")


def frame(middle, degrees, *, chess, size=(6, 8), square=22.0, margin=0.5, board=230.0):
    """A board turned by degrees, clockwise, and its corners in the order of `ORDER` from the upper left one on."""
    random = np.random.default_rng(int(sum(middle)))
    # Four times as large, and reduced: edges are as soft as a camera's.
    image = np.full((1600, 2560), 110.0, np.float32)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = np.array([[c, s], [-s, c]])

    def paint(columns, rows, level):
        corners = np.array(
            [(columns[0], rows[0]), (columns[1], rows[0]), (columns[1], rows[1]), (columns[0], rows[1])]
        )
        corners = (corners - np.array(size[::-1]) / 2.0) * square @ turned + middle
        cv2.fillPoly(image, [np.rint((corners + 0.5) * 4.0).astype(np.int32)], level)
        return corners

    corners = paint((-margin, size[1] + margin), (-margin, size[0] + margin), board)
    for row in range(size[0] if chess else 0):
        for column in range(row % 2, size[1], 2):
            paint((column, column + 1), (row, row + 1), 30.0)
    image = cv2.resize(image, (640, 400), interpolation=cv2.INTER_AREA)
    return np.clip(image + random.normal(0.0, 2.0, image.shape), 0.0, 255.0).astype(np.uint8), corners


def off_px(seeds, corners):
    return [float(np.hypot(*(seeds.pixels[name] - at).T).min()) for name, at in zip(ORDER, corners, strict=True)]


@pytest.mark.parametrize("upper_corner", [0, 1, -1])
@pytest.mark.parametrize("find", [find_chessboard_seeds, find_outline_seeds])
def test_all_corners_of_a_board_are_seeds(find, upper_corner):
    places = [(180.0, 200.0), (320.0, 190.0), (450.0, 210.0)]
    drawn = [frame(at, TURNED[upper_corner] + 4.0, chess=find is find_chessboard_seeds) for at in places]
    alternatives = find([image for image, _ in drawn], range(3), upper_corner)
    off = [max(off_px(seeds[k], drawn[k][1]) for k in range(3)) for seeds in alternatives]
    assert min(max(each) for each in off) < 4.0


def test_a_board_beyond_the_rim_has_seeds_of_the_corners_that_are_seen():
    image, corners = frame((320.0, 60.0), 45.0, chess=False)
    ((seeds,),) = find_outline_seeds([image], [0])
    assert "top" not in seeds.pixels
    assert np.hypot(*(seeds.pixels["bottom"] - corners[2]).T).min() < 3.0


def test_frames_of_noise_have_no_seed():
    frames = [np.random.default_rng(k).integers(90, 130, (400, 640)).astype(np.uint16) for k in range(10)]
    for find in (find_chessboard_seeds, find_outline_seeds):
        assert not any(one.pixels for seeds in find(frames, range(10)) for one in seeds)
