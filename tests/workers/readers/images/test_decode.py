"""How small frames are made before anything looks at them."""

import cv2
import numpy as np
import pytest

from workers.readers.images.decode import decoded, reduced


@pytest.mark.parametrize(
    ("width", "height", "factor"),
    [
        (1024, 768, 1),
        (1920, 1200, 2),
        (8000, 3000, 8),
        (20_000, 400, 8),  # wider than an eighth allows, but small
        (600, 1500, 1),
        (600, 6000, 2),  # narrow and tall: it has more pixels than a square of this width
        (900, 60_000, 8),
        (9000, 9000, None),
    ],
)
def test_images_are_as_wide_and_have_as_many_pixels_as_is_needed(width, height, factor):
    assert reduced(width, height, 1024) == factor


def test_tall_narrow_frames_are_made_smaller():
    tall = cv2.imencode(".png", np.zeros((4000, 100), np.uint8))[1].tobytes()
    assert decoded(tall, colour=False, widest=256).shape == (1000, 25)
    assert decoded(tall, colour=True, widest=64) is None
