"""Planned vertices in people's words."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from workers.geometry.models import INTRINSICS
from workers.solver.planned_vertices import plan_sentences
from workers.solver.polish import polish
from workers.solver.uncertainty import uncertainty


def numbers(sentence):
    return {words: float(value) for words, value in re.findall(r"(\w+) to ([0-9.]+) ", sentence)}


@pytest.mark.parametrize("search", ["rotation_vector", "euler"])
def test_the_words_say_what_the_marks_then_show(search):
    problem, truth = simulated("pinhole", 95, pairs=60)
    nothing_marked = replace(problem, pixels=np.zeros_like(problem.pixels))
    (sentence,) = plan_sentences(nothing_marked, truth)
    assert sentence.startswith("These 60 vertices would give yaw to ")
    assert "degrees" in sentence and " mm" in sentence and " px" in sentence and "e-" not in sentence
    after = uncertainty(problem, np.array(polish(problem, truth).parameters))
    std = dict(zip(after.names, after.std, strict=True))
    said = numbers(sentence)
    assert said["yaw"] == pytest.approx(std["rotation_y"], rel=0.3)
    assert said["place"] == pytest.approx(1000 * max(std[f"t_{axis}"] for axis in "xyz"), rel=0.3)
    assert said["lengths"] == pytest.approx(max(std["f_x"], std["f_y"]), rel=0.3)
    if search == "euler":
        turned, _ = simulated("pinhole", 95, pairs=60, search="euler", locked={"alpha": np.pi / 2})
        p = 0.5 * (turned.lower + turned.upper)
        assert "any rotation to" in plan_sentences(turned, p)[0]


def test_a_known_lens_and_more_vertices_are_worth_saying():
    problem, truth = simulated("pinhole", 96, pairs=60)
    locks = dict(zip(INTRINSICS["pinhole"], truth[6:].tolist(), strict=True))
    known, _ = simulated("pinhole", 96, pairs=60, locked=locks)
    free_words, locked_words = (plan_sentences(one, truth)[0] for one in (problem, known))
    assert "focal" not in locked_words
    assert numbers(locked_words)["yaw"] < 0.5 * numbers(free_words)["yaw"]


def test_what_would_stay_open_is_said():
    problem, truth = simulated("pinhole", 97, pairs=60)
    flat = problem.points.copy()
    flat[:, 0] = 9.0
    (open_words,) = plan_sentences(replace(problem, points=flat), truth)
    assert "would not determine yaw, pitch" in open_words and "other distances" in open_words
    locked, _ = simulated("pinhole", 97, pairs=60, locked={"f_x": truth[6], "f_y": truth[7]})
    assert "would give yaw" in plan_sentences(replace(locked, points=flat), truth)[0]
    (alone,) = plan_sentences(replace(problem, points=-problem.points), truth)
    assert alone == "These 60 vertices would determine nothing: the camera does not see them."
