"""The next best steps: what the mount's stated interval is made of, and what would narrow it most.

Each step is planned from the linearised fit: marks that are not made yet are rows of its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ANGLES
from apexcal.documents.checks import alone_over_limits, figure
from apexcal.documents.lenses import stated_deviation
from apexcal.documents.precision import NextStep, NextSteps, StepKind
from workers.solver.common_errors import beside_decentring, columns_of, common_errors
from workers.solver.error_model import ErrorModel, linearised
from workers.solver.estimate import Estimate
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
MARKS: Final = 12
"""Marks of one step: some minutes of a person's work."""
_MOST_STEPS: Final = 4
_WORTH: Final = 0.95  # of the interval: a step that leaves more is not worth its work
_MEASURED_MM: Final = 1.0  # what a rule tells of a board's edges and tip
_COLUMNS: Final = ("left edge", "left", "middle", "right", "right edge")
_ROWS: Final = ("top", "", "bottom")
_DISTANCES: Final = {"near": 0.1, "far": 0.9}  # quantiles of the marked distances
_HEIGHTS: Final = (0.05, 0.95)
_BOARD: Final = (
    *("tip_across_mm", "tip_up_mm", "range_mm", "azimuth_deg", "elevation_deg"),
    *("tilt_up_deg", "tilt_across_deg", "corners_out_mm"),
)
_PARTS: Final = {
    "clock": ("clock_ms", "line_time_us"),
    "board": _BOARD,
    "people": ("person_px", "mark_u_px", "mark_v_px"),
}


@dataclass(frozen=True, eq=False)
class _Plan:
    """A fit as it would be: errors of made and planned marks, which rows (N,) count, and the planned rows' names."""

    errors: ErrorModel
    used: NDArray[np.bool_]
    places: dict[int, str]

    def deviations(self) -> Floats:
        return np.sqrt(np.diag(self.errors.covariance(self.used)))

    def scaled(self, factors: dict[str, float]) -> _Plan:
        by_column = np.array([factors.get(term, 1.0) for term in self.errors.terms])
        return replace(self, errors=replace(self.errors, common=self.errors.common * by_column))

    def with_lens(self, sigmas: Floats) -> _Plan:
        """Return the plan with a prior on the unknowns whose deviation (F,) is finite."""
        fit = self.errors.fit
        prior = fit.prior + np.diag((self.errors.scale / sigmas) ** 2)
        return replace(self, errors=replace(self.errors, fit=replace(fit, prior=prior)))


class _Mount:
    """The mount's stated half widths, and how they follow from planned deviations (F,)."""

    def __init__(self, estimate: Estimate, plan: _Plan) -> None:
        self.names, half = estimate.spread.names, estimate.spread.half_width95
        self.turns = np.array([i for i, name in enumerate(self.names) if name in ANGLES], np.int64)
        self.shifts = np.array([i for i, name in enumerate(self.names) if name.startswith("t_")], np.int64)
        self._factor = half / plan.deviations()[: len(half)]

    def half_widths(self, deviations: Floats) -> tuple[float, float]:
        """The largest of the turns, degrees, and of the shifts, mm."""
        half = self._factor * deviations[: len(self._factor)]
        return float(half[self.turns].max(initial=0.0)), 1e3 * float(half[self.shifts].max(initial=0.0))

    def over_limit(self, deviations: Floats) -> float:
        """The larger of both over what the mount alone may have."""
        return max(alone_over_limits(*self.half_widths(deviations)))

    def widest(self, deviations: Floats) -> int:
        """The index of the parameter that decides `over_limit`."""
        indices = self.turns if _is_turn_wider(*self.half_widths(deviations)) else self.shifts
        return int(indices[np.argmax((self._factor * deviations[: len(self._factor)])[indices])])


def next_steps(estimate: Estimate) -> NextSteps | None:
    """Return the parts of the mount's interval, and up to four steps, the best first, each with what it promises.

    None if the pairs leave a direction open or the mount is locked.
    """
    if estimate.errors is None or not any(name in ANGLES or name[:2] == "t_" for name in estimate.spread.names):
        return None
    problem, p = whitened(estimate.holding, estimate.held_at), estimate.held_at
    plan, lens = _planned(problem, p, estimate), _lens_sigmas(problem, p)
    mount = _Mount(estimate, plan)
    now = plan.deviations()
    turn, shift = mount.half_widths(now)
    people = 1 if problem.people is None else int(np.count_nonzero(problem.people.sum(axis=0)))
    steps: list[NextStep] = []
    done: set[StepKind] = set()
    parts = _parts(plan, lens, mount.widest(now), (turn, shift))
    # Where the check `mount_alone` would pass, no further step is named.
    while len(steps) < _MOST_STEPS and not (steps and mount.over_limit(now) <= 1.0):
        ways: list[tuple[StepKind, str, _Plan]] = []
        if np.any(np.isfinite(lens)) and problem.stated_lens is None and "lens" not in done:
            ways.append(("lens", "give a lens file", plan.with_lens(_padded(lens, plan.errors))))
        board = {name: min(1.0, _MEASURED_MM / problem.common_errors.get(name, 1.0)) for name in _BOARD[:2]}
        if min(board.values()) < 1.0 and "board" not in done:
            ways.append(("board", f"measure the board's edges and corner to {_MEASURED_MM:g} mm", plan.scaled(board)))
        if "person_px" in plan.errors.terms:
            more = plan.scaled({"person_px": float(np.sqrt(people / (people + 1.0)))})
            ways.append(("person", f"let {'a second' if people == 1 else 'another'} person mark", more))
        if plan.places:
            row = _best_place(plan, mount.widest(now))
            used = plan.used.copy()
            used[row] = True
            rest = {other: name for other, name in plan.places.items() if other != row}
            marks = replace(plan, used=used, places=rest)
            ways.append(("marks", f"{MARKS} more marks at the {plan.places[row]}", marks))
        ends = [after.deviations() for _, _, after in ways]
        limits = [mount.over_limit(end) for end in ends]
        if min(limits, default=np.inf) > _WORTH * mount.over_limit(now):
            break
        best = int(np.argmin(limits))
        kind, words, plan = ways[best]
        now, people = ends[best], people + (kind == "person")
        done.add(kind)
        half_deg, half_mm = mount.half_widths(now)
        steps.append(NextStep(kind=kind, words=words, half_width_deg=half_deg, half_width_mm=half_mm))
    return NextSteps(half_width_deg=turn, half_width_mm=shift, parts=parts, steps=steps)


def sentence(steps: NextSteps) -> str:
    """The parts and the steps in words; empty if no step is worth its work."""
    if not steps.steps:
        return ""
    is_turn = _is_turn_wider(steps.half_width_deg, steps.half_width_mm)
    unit = "degrees" if is_turn else "mm"
    whole = steps.half_width_deg if is_turn else steps.half_width_mm
    most = max(steps.parts, key=lambda name: steps.parts[name])
    ways = "; then ".join(
        f"{step.words} (±{figure(step.half_width_deg if is_turn else step.half_width_mm)})" for step in steps.steps
    )
    share = f"Most of the mount's ±{figure(whole)} {unit} comes from the {most} ({figure(steps.parts[most])})"
    return f"{share}. Next: {ways}."


def _is_turn_wider(half_width_deg: float, half_width_mm: float) -> bool:
    """Whether the turn is wider than the shift, each over its limit."""
    turn, shift = alone_over_limits(half_width_deg, half_width_mm)
    return turn >= shift


def _planned(problem: FitProblem, p: Floats, estimate: Estimate) -> _Plan:
    """The plan without any step: planned rows stand for `MARKS` marks each and do not count yet."""
    errors, points, names = estimate.errors, *_places(problem, p)
    assert errors is not None
    n, used = len(problem.points), problem.weights > 0.0
    rows = np.flatnonzero(used)
    apart = np.linalg.norm(points[:, None] - problem.points[rows], axis=2)
    near = rows[np.argmin(apart, axis=1)] if len(points) else rows[:0]
    pixels = np.zeros((len(points), 2))

    def grown(values: Floats | None) -> Floats | None:
        return None if values is None else np.concatenate([values, values[near]])

    there = replace(
        problem,
        points=np.concatenate([problem.points, points]),
        pixels=np.concatenate([problem.pixels, pixels]),
        weights=np.concatenate([problem.weights, np.full(len(points), float(MARKS))]),
        covariances=problem.covariances and problem.covariances.of([*range(n), *near.tolist()]),
        whitening=grown(problem.whitening),
        velocities=grown(problem.velocities),
        people=grown(problem.people),
        blocks=None,
    )
    there = replace(there, pixels=np.concatenate([problem.pixels, predict(there, p)[0][n:]]))
    fit, scale = linearised(there, p)
    common, terms = common_errors(there, p)
    if estimate.bias is not None:
        people = there.people if there.people is not None else np.ones((len(there.points), 1))
        shifts = estimate.bias.px * columns_of(there, people)
        common, terms = np.concatenate([common, shifts], axis=2), terms + ("person_px",) * shifts.shape[2]
    # The marks of a step lie near each other in time, in groups of their own.
    alone = np.arange(len(points))
    shared = tuple(
        replace(
            each,
            labels=np.concatenate([each.labels, each.labels.max() + 1 + alone]),
            moments=np.concatenate([each.moments, 0.0 * alone]),
            shapes=np.concatenate(
                [
                    each.shapes,
                    each.shapes[near]
                    * np.sqrt((MARKS if each.lasts < np.inf else 1.0) / problem.weights[near])[:, None, None],
                ]
            ),
        )
        for each in errors.shared
    )
    planned = replace(errors, fit=fit, scale=scale, common=common, terms=terms, shared=shared, moved=np.zeros(0))
    planned = replace(beside_decentring(there, p, planned), moved=np.zeros(0))
    return _Plan(planned, np.arange(len(there.points)) < n, {n + i: name for i, name in enumerate(names)})


def _places(problem: FitProblem, p: Floats) -> tuple[Floats, list[str]]:
    """(K, 3) tips that the camera would see at distances and heights of the walk, and the words for each place."""
    used = problem.points[problem.weights > 0.0]
    turns = np.radians(np.arange(0.0, 360.0, 2.0))
    points: list[Floats] = []
    words: list[str] = []
    for word, share in _DISTANCES.items():
        flat = float(np.quantile(np.hypot(used[:, 0], used[:, 1]), share))
        for height in np.quantile(used[:, 2], _HEIGHTS).tolist():
            ring = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), np.full(len(turns), height)])
            points.append(ring)
            words += [word] * len(ring)
    ring = np.concatenate(points)
    there = replace(
        problem, points=ring, pixels=np.zeros((len(ring), 2)), weights=np.ones(len(ring)),
        covariances=None, whitening=None, blocks=None, velocities=None, people=None,
    )  # fmt: skip
    pixels, violation = predict(there, p)
    size = np.array(problem.image_size)
    inside = (violation == 0.0) & np.all((pixels >= 0.0) & (pixels <= size - 1.0), axis=1)
    by_name: dict[str, list[int]] = {}
    for row in np.flatnonzero(inside).tolist():
        column, line = (int(share) for share in pixels[row] / size * (len(_COLUMNS), len(_ROWS)))
        name = " ".join(filter(None, (_ROWS[line], _COLUMNS[column])))
        by_name.setdefault(f"{name}, {words[row]}", []).append(row)
    middles = [rows[len(rows) // 2] for rows in by_name.values()]
    return ring[middles].reshape(-1, 3), list(by_name)


def _best_place(plan: _Plan, index: int) -> int:
    """The planned row whose marks narrow that parameter most, by their information alone."""
    rows = list(plan.places)
    J, Q = plan.errors.fit.jacobian[rows], plan.errors.inverse(plan.used)
    A = J @ Q
    S = plan.errors.noise * np.eye(2) + A @ J.swapaxes(1, 2)
    toward = A[:, :, index]
    gains = np.einsum("ki,kij,kj->k", toward, np.linalg.inv(S), toward)
    return rows[int(np.argmax(gains))]


def _lens_sigmas(problem: FitProblem, p: Floats) -> Floats:
    """(F,) deviations that a stated lens would have; infinite for the mount."""
    sigmas = np.full(len(problem.free), np.inf)
    indices: list[int] = problem.free.tolist()
    for k, index in enumerate(indices):
        if index >= 6:
            name = problem.names[index]
            sigmas[k] = stated_deviation(problem.model, name, float(p[index]), problem.image_size[0])
    return sigmas


def _padded(sigmas: Floats, errors: ErrorModel) -> Floats:
    return np.pad(sigmas, (0, len(errors.scale) - len(sigmas)), constant_values=np.inf)


def _parts(plan: _Plan, lens: Floats, index: int, half: tuple[float, float]) -> dict[str, float]:
    """Return the widest parameter's half width with each error alone, degrees or mm."""
    errors = plan.errors
    whole = float(errors.covariance(plan.used)[index, index])
    by_term = errors.by_common(plan.used)[index] ** 2
    variances = {
        part: float(sum(v for v, term in zip(by_term.tolist(), errors.terms, strict=True) if term in terms))
        for part, terms in _PARTS.items()
    }
    exact = plan.with_lens(_padded(1e-6 * lens, errors)).errors.of_pairs().covariance(plan.used)[index, index]
    own = float(errors.of_pairs().covariance(plan.used)[index, index])
    variances |= {"lens": own - float(exact), "marks": float(exact)}
    is_turn = _is_turn_wider(*half)
    whole_half = half[0] if is_turn else half[1]
    return {part: whole_half * float(np.sqrt(v / whole)) for part, v in variances.items() if v > 1e-4 * whole}
