"""Seeds from what differs from the still background."""

import cv2
import numpy as np
import pytest

from workers.marks.seeds import find_seeds, spread_over


def recording(gain=1.0, contrast=40.0, count=12, dtype=np.uint8):
    random = np.random.default_rng(1)
    background = 90.0 + cv2.resize(random.normal(0.0, 25.0, (20, 32)).astype(np.float32), (640, 400))
    frames, tips = [], []
    for index in range(count):
        image = background.copy()
        tip = np.array([120.0 + 35.0 * index, 120.0 + 5.0 * (index % 3)])
        cv2.fillPoly(
            image,
            [np.rint(tip + np.array([(0, 0), (-50, 55), (0, 110), (50, 55)])).astype(np.int32)],
            200.0 - contrast,
        )
        image = (gain if index >= count // 2 else 1.0) * image + random.normal(0.0, 1.0, image.shape)
        frames.append(
            np.clip(np.rint(image * (30.0 if dtype is np.uint16 else 1.0)), 0, np.iinfo(dtype).max).astype(dtype)
        )
        tips.append(tip)
    return frames, np.array(tips)


def off_by(frames, tips):
    seeds = find_seeds(frames, range(len(frames)))
    return [float(np.hypot(*(one.pixels["top"] - tips[one.frame]).T).min()) for one in seeds]


@pytest.mark.parametrize("how", [{}, {"gain": 0.6}, {"dtype": np.uint16}])
def test_the_tip_is_a_seed_of_each_frame_also_after_a_step_of_the_exposure(how):
    frames, tips = recording(**how)
    assert max(off_by(frames, tips)) < 6.0
    gains = [one.gain for one in find_seeds(frames, range(len(frames)))]
    assert abs(min(gains) / max(gains) - how.get("gain", 1.0)) < 0.05


def test_still_frames_have_no_seed():
    frames, _ = recording()
    assert all(not one.pixels for one in find_seeds([frames[0]] * 10, range(10)))


def test_frames_are_spread_over_the_recording():
    assert spread_over(range(1000), 64)[::63] == [0, 999]
    assert spread_over([5, 3, 3], 64) == [3, 5]
