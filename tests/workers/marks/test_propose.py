"""The whole way from frames and vertices to proposals, on a rendered recording."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.corners import CORNERS
from benchmarks.marks.draws import Draw, draw
from benchmarks.marks.scenes import Scene
from workers.marks.propose import propose
from workers.marks.sights import MarkProposal

DRAW = Draw(
    seed=4242, size=(960, 600), model="brown_conrady", lens_stated=True, still=True, count=14, board_m=(0.6, 0.9),
    size_stated=True, pattern="border", contrast=70.0, texture=5.0, blur_px=0.8, noise=1.5, motion_ms=0.0,
    head_above_m=0.0, second="none", gain_step=1.2, tip_outside=False, thermal=False,
)  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return Scene(DRAW)


@pytest.fixture(scope="module")
def frames(scene):
    return [scene[index] for index in range(len(scene))]


def errors_px(scene, answers, name="top"):
    return [
        float(np.hypot(*(np.array(answer[name].pixel) - scene.truth[name][index])))
        for index, answer in enumerate(answers)
        if isinstance(answer.get(name), MarkProposal) and scene.visible(index, name)
    ]


def test_tips_are_marked(scene, frames):
    found = propose(frames, scene.sights, DRAW.size, lens=scene.lens, corners=("top", "left"))
    assert found.failure is None and found.offset_s == 0.0
    for name in ("top", "left"):
        errors = errors_px(scene, found.answers, name)
        assert len(errors) >= 0.7 * len(scene)
        assert np.median(errors) < 0.4
        # A leg may stand where a lower edge ends; nothing hides a tip here.
        assert np.sum(np.array(errors) > 1.0) <= (0 if name == "top" else 1)
    assert all(
        0.0 < answer["top"].sigma_px < 3.0 for answer in found.answers if isinstance(answer["top"], MarkProposal)
    )


@pytest.mark.parametrize("upper_corner", [1, -1])
def test_upper_corners_of_level_boards_are_marked(upper_corner):
    drawn = replace(DRAW, upper_corner=upper_corner)
    scene = Scene(drawn)
    frames = [scene[index] for index in range(len(scene))]
    found = propose(frames, scene.sights, drawn.size, lens=scene.lens, corners=CORNERS, upper_corner=upper_corner)
    assert found.failure is None
    for name in ("top", "right" if upper_corner > 0 else "left"):
        errors = errors_px(scene, found.answers, name)
        assert len(errors) >= 0.7 * len(scene) and max(errors) < 1.0


def test_without_corners_the_roll_tells_the_edges(scene, frames):
    bare = [type(one)(one.frame, {"top": one.corners["top"]}, one.covariance, one.roll) for one in scene.sights]
    errors = errors_px(scene, propose(frames, bare, DRAW.size, lens=scene.lens).answers)
    assert len(errors) >= 0.5 * len(scene)
    assert np.median(errors) < 0.5


def test_too_few_poses_are_said(scene, frames):
    for lens, count in ((scene.lens, 5), (None, 7)):
        found = propose(frames, scene.sights[:count], DRAW.size, lens=lens)
        assert found.failure is not None
        assert (found.failure.reason, len(found.answers)) == ("few_poses", count)
        assert found.failure.sentence.startswith(f"{count} corners have a frame; the machine needs {count + 1}.")


def test_six_poses_suffice_with_a_stated_lens(scene, frames):
    found = propose(frames, scene.sights[:6], DRAW.size, lens=scene.lens)
    errors = errors_px(scene, found.answers)
    assert len(errors) >= 5 and max(errors) < 1.0
    order = [1, 2, 3, 4, 5, 0]
    mixed = [
        type(one)(one.frame, scene.sights[k].corners, one.covariance, one.roll)
        for one, k in zip(scene.sights, order, strict=False)
    ]
    assert propose(frames, mixed, DRAW.size, lens=scene.lens).camera is None


def test_a_board_that_stays_in_one_place_is_marked():
    """Seven poses within 3.3 degrees of one place hide the background from their own median."""
    scene, near = Scene(replace(DRAW, count=24, gain_step=1.0)), (2, 12, 13, 16, 17, 18, 19)
    frames, sights = [scene[index] for index in range(len(scene))], [scene.sights[index] for index in near]
    for background in ((), [index for index in range(len(scene)) if index not in near]):
        found = propose(frames, sights, DRAW.size, lens=scene.lens, background=background)
        marks = [answer["top"] for answer in found.answers]
        assert all(isinstance(mark, MarkProposal) for mark in marks)
        pixels = np.array([mark.pixel for mark in marks if isinstance(mark, MarkProposal)])
        assert np.hypot(*(pixels - scene.truth["top"][list(near)]).T).max() < 1.0


def test_the_clock_is_told_by_the_marks_of_a_walk():
    """The vertices are of 35 ms after the frames: where the board is no longer."""
    drawn = replace(DRAW, still=False, count=36, pattern="plain", gain_step=1.0, clock_ms=35.0)
    scene = Scene(drawn)
    frames = [scene[index] for index in range(len(scene))]
    found = propose(frames, scene.sights, drawn.size, lens=scene.lens)
    assert abs(found.offset_s - 0.035) < 0.008
    errors = errors_px(scene, found.answers)
    assert len(errors) >= 0.7 * len(scene) and max(errors) < 2.0
    assert all(np.array_equal(sight.velocity, np.zeros(3)) for sight in Scene(DRAW).sights)


def test_vertices_of_another_recording_get_no_mount(scene, frames):
    random = np.random.default_rng(8)
    order = random.permutation(len(scene))
    mixed = [
        type(one)(one.frame, scene.sights[k].corners, one.covariance, one.roll)
        for one, k in zip(scene.sights, order, strict=True)
    ]
    found = propose(frames, mixed, DRAW.size, lens=scene.lens)
    assert found.camera is None
    assert found.failure is not None and "--board" not in found.failure.sentence
    bare = [type(one)(one.frame, {"top": one.corners["top"]}, one.covariance, one.roll) for one in mixed]
    found = propose(frames, bare, DRAW.size, lens=scene.lens)
    assert found.failure is not None and "board's size (--board)" in found.failure.sentence


def test_edges_that_fit_badly_are_no_second_mount():
    # Without corners a mount beside the true one sees edges in most frames, but not where its vertices are.
    drawn = draw(9017)
    scene = Scene(drawn)
    frames = [scene[index] for index in range(len(scene))]
    marks = propose(frames, scene.sights, drawn.size, lens=scene.lens, model=drawn.model)
    assert marks.failure is None
    assert len(errors_px(scene, marks.answers)) >= 20 and max(errors_px(scene, marks.answers)) < 5.0


def test_a_rim_of_the_background_s_brightness_is_marked():
    """Every other square of the chessboard's rim is as bright as what is behind it."""
    drawn = draw(9014)
    scene = Scene(drawn)
    frames = [scene[index] for index in range(len(scene))]
    marks = propose(frames, scene.sights, drawn.size, lens=scene.lens, model=drawn.model, corners=CORNERS)
    errors = errors_px(scene, marks.answers)
    assert len(errors) >= 10 and max(errors) < 1.0


def test_marks_that_no_mount_explains_are_no_marks(scene, frames):
    """The vertices lie off by several times what they state."""
    random = np.random.default_rng(3)
    off = [random.normal(0.0, 0.015, 3) for _ in scene.sights]
    sights = [
        replace(one, corners={name: at + shift for name, at in one.corners.items()})
        for one, shift in zip(scene.sights, off, strict=True)
    ]
    marks = propose(frames, sights, DRAW.size, lens=scene.lens)
    assert marks.failure is not None and marks.failure.reason == "few_edges"
    assert "scatter" in marks.failure.sentence
    assert marks.camera is None and not errors_px(scene, marks.answers)


def test_a_board_that_may_stay_is_asked_for_its_size(scene, frames):
    """Without a size the machine cannot know what the board hides."""
    sentences = []
    for names in (CORNERS, ("top",)):
        still = [
            type(one)(index, {name: scene.sights[0].corners[name] for name in names}, one.covariance, one.roll)
            for index, one in enumerate(scene.sights)
        ]
        found = propose([frames[0]] * len(frames), still, DRAW.size, lens=scene.lens)
        assert found.failure is not None and found.failure.reason == "in_one_place"
        sentences.append(found.failure.sentence)
    assert "board hides" in sentences[0] and "--board" not in sentences[0]
    assert "board may hide" in sentences[1] and "(--board)" in sentences[1]
