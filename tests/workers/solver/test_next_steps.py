"""The next best steps, followed literally: what each promises is what comes."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.lenses import stated_deviation
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import simulated
from workers.geometry.models import INTRINSICS
from workers.solver.estimate import estimate
from workers.solver.next_steps import MARKS, _places, next_steps, sentence
from workers.solver.residuals import predict

BOARD = {"tip_across_mm": 3.5, "tip_up_mm": 5.8, "person_px": 0.289}


def taken(problem, truth, p, step, random):
    """The problem after the step, with errors as the step's words have them."""
    if step.kind == "marks":
        points, names = _places(problem, p)
        place = points[names.index(step.words.removeprefix(f"{MARKS} more marks at the "))]
        more = place + random.normal(0.0, 0.1, (MARKS, 3))
        points = np.concatenate([problem.points, more])
        there = replace(
            problem, points=points, pixels=np.zeros((len(points), 2)), weights=np.ones(len(points)), people=None
        )
        pixels = predict(there, truth)[0] + random.normal(size=(len(points), 2))
        people = problem.people
        if people is not None:
            people = np.concatenate([people, np.tile(people.mean(axis=0), (MARKS, 1))])
        return replace(there, pixels=np.concatenate([problem.pixels, pixels[-MARKS:]]), people=people)
    if step.kind == "lens":
        lens = dict(zip(INTRINSICS[problem.model], truth[6:].tolist(), strict=True))
        width = problem.image_size[0]
        sigmas = {name: stated_deviation(problem.model, name, value, width) for name, value in lens.items()}
        # In the lens's order: that of a set differs from process to process, and with it the draws.
        free = [name for name in lens if problem.names.index(name) in problem.free]
        priors = {name: (lens[name] + sigmas[name] * random.normal(), sigmas[name]) for name in free}
        return replace(problem, priors=priors, stated_lens={"model": problem.model, **lens}, unstated=frozenset())
    if step.kind == "board":
        return replace(problem, common_errors=problem.common_errors | {"tip_across_mm": 1.0, "tip_up_mm": 1.0})
    assert step.kind == "person"
    people = 1 if problem.people is None else problem.people.shape[1]
    return replace(problem, people=np.full((len(problem.points), people + 1), 1.0 / (people + 1)))


@few_or_many(2, 10)
@pytest.mark.parametrize("model", ["pinhole", "brown_conrady", "kannala_brandt"])
def test_each_step_followed_from_sixty_marks_on_brings_what_it_promises(model, draws):
    ratios = []
    for seed in range(draws):
        problem, truth = simulated(model, 8100 + seed, pairs=60)
        problem = replace(problem, common_errors=BOARD)
        random = np.random.default_rng([seed, 73])
        for _ in range(10):
            fitted = estimate(problem, truth)
            steps = next_steps(fitted)
            if not steps.steps:
                break
            step = steps.steps[0]
            problem = taken(problem, truth, fitted.parameters, step, random)
            came = next_steps(estimate(problem, truth))
            is_turn = steps.half_width_deg / 0.4 >= steps.half_width_mm / 40.0
            ratios.append(
                came.half_width_deg / step.half_width_deg if is_turn else came.half_width_mm / step.half_width_mm
            )
    near = np.abs(np.array(ratios) - 1.0) <= 0.2
    assert len(ratios) >= draws and near.mean() >= 0.9


def test_the_words_name_the_parts_and_the_steps_and_a_locked_mount_has_none():
    problem, truth = simulated("brown_conrady", 8200, pairs=60)
    steps = next_steps(estimate(replace(problem, common_errors=BOARD), truth))
    words = sentence(steps)
    assert words.startswith("Most of the mount's ±") and " comes from the lens " in words and "Next: " in words
    assert max(steps.parts.values()) <= max(steps.half_width_deg, steps.half_width_mm)
    mount = dict(zip(problem.names[:6], truth[:6].tolist(), strict=True))
    assert next_steps(estimate(replace(problem, locked=mount), truth)) is None
