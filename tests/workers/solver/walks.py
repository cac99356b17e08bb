"""Simulated poses and walks of a pinhole camera whose pairs share errors, and their results as documents."""

from dataclasses import replace

import numpy as np

from tests.workers.solver.rigs import plain, simulated
from workers.solver.blocks import Blocks, blocks_of
from workers.solver.narrowing import start
from workers.solver.residuals import predict
from workers.solver.solution import finished

CORNERS = np.array([[0, 0, 0.42], [0, 0.42, 0], [0, -0.42, 0], [0, 0, -0.42]])


def posed(seed, poses=20, repeats=1, offset_m=0.0, turn_deg=0.0, noise_px=1.0, **request):
    """(problem, truth): four corners of a board in so many poses within 12 m, marked so often; a pose's err alike."""
    problem, truth = simulated("pinhole", seed, noise_px=0.0, **request)
    rng = np.random.default_rng((seed, 1))
    distance = np.linalg.norm(problem.points, axis=1)
    middles = problem.points[np.argsort(distance)[:120:2]]
    middles = middles[rng.permutation(len(middles))[:poses]]
    arms = np.tile(CORNERS, (repeats, 1))
    points = (middles[:, None] + arms).reshape(-1, 3)
    labels = np.repeat(np.arange(poses), len(arms))
    turns = np.radians(turn_deg) * rng.normal(size=(poses, 3))
    off = offset_m * rng.normal(size=(poses, 3))
    moved = points + off[labels] + np.cross(turns[labels], np.tile(arms, (poses, 1)))
    given = {"weights": np.ones(len(points)), "pixels": np.zeros((len(points), 2))}
    pixels = predict(replace(problem, points=moved, **given), truth)[0]
    given["pixels"] = pixels + noise_px * rng.normal(size=pixels.shape)
    return replace(problem, points=points, blocks=Blocks(labels, "group"), **given), truth


def walked(seed, turned_deg=0.0, model="pinhole", **request):
    """(problem, truth): a walk along lanes; the camera turns to the side in the middle of it by so much."""
    problem, truth = simulated(model, seed, noise_px=0.0, **request)
    rng = np.random.default_rng((seed, 2))
    lane = np.argsort(np.argsort(problem.points[:, 0])) // 37
    order = np.lexsort((np.where(lane % 2, -1, 1) * problem.points[:, 1], lane))
    points = problem.points[order]
    here = replace(problem, points=points)
    pixels = predict(here, truth)[0]
    turned = truth.copy()
    turned[1] += np.radians(turned_deg)
    half = len(points) // 2
    pixels[half:] = predict(here, turned)[0][half:]
    pixels += rng.normal(size=pixels.shape)
    blocks = blocks_of({"x": points[:, 0], "stamp_ns": np.arange(len(points)) * 400_000_000})
    return replace(here, pixels=pixels, blocks=blocks), truth


def ended(problem, parameters):
    """The end of a search that came to these parameters: estimate and result."""
    searched = {"best_parameters": tuple(parameters), "best_loss": 2.0, "history": (2.0,)}
    return finished(problem, replace(start(problem), iteration=1, stopped="converged", **searched))


def finish(problem, parameters):
    """The result of a search that ended at these parameters, as it is stored."""
    return plain(ended(problem, parameters).result)


class Recomputed:
    """A pinhole's residuals and derivatives from a document and its pairs, with NumPy alone; small turns, t, f, c."""

    def __init__(self, document, points, marks):
        self.document, self.points, self.marks = document, points, marks
        self.R = np.array(document["transform"]["rotation"]["matrix"])
        self.t = np.array(document["transform"]["translation_m"])
        lens = document["intrinsics"]
        self.lens = np.array([lens[name] for name in ("f_x", "f_y", "c_x", "c_y")])
        self.residuals = (self.project(np.zeros(10)) - marks).ravel()
        self.J = self.derivative(lambda x: self.project(x), 10)
        names = document["covariance"]["names"]
        assert names[:3] == ["rotation_x", "rotation_y", "rotation_z"] and len(names) == 10
        self.unit = np.array([180 / np.pi] * 3 + [1.0] * 7)
        self.covariance = np.array(document["covariance"]["matrix"]) / np.outer(self.unit, self.unit)

    def project(self, x, points=None):
        seen = (self.points if points is None else points) @ self.R.T
        # exp of a turn of a millionth, to second order.
        turned = seen + np.cross(x[:3], seen) + 0.5 * np.cross(x[:3], np.cross(x[:3], seen)) + self.t + x[3:6]
        f, c = self.lens[:2] + x[6:8], self.lens[2:] + x[8:10]
        return turned[:, :2] / turned[:, 2:] * f + c

    def derivative(self, function, count, h=1e-6):
        steps = h * np.eye(count)
        return np.stack([((function(s) - function(-s)) / (2 * h)).ravel() for s in steps], axis=1)

    def by_pairs(self, moves):
        """(2 N, q): derivatives of the pixels by q numbers; moves(x) -> (N, 3) are the points moved by them."""
        return self.derivative(lambda x: self.project(np.zeros(10), moves(x)), len(moves(None)))
