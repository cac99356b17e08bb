"""Machine marks of one camera: seeds, the mount that they agree on, edges, and the mount again from the edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from apexcal.documents.corners import CORNERS, CornerName
from workers.geometry.models import ModelName
from workers.marks.alternatives import Beside
from workers.marks.board_seeds import find_chessboard_seeds, find_outline_seeds
from workers.marks.clock_search import at_best_clock, at_marked_clock
from workers.marks.edges import CornerFit
from workers.marks.measuring import SHAPE_M, CornerKey, MarkTask, Measured, OnSight, measure, with_alternatives
from workers.marks.mount_fit import fit_mount
from workers.marks.mount_search import (
    INLIER_PX,
    LEAST_PAIRS,
    LEAST_SHARE,
    LEAST_WITH_LENS,
    RIVAL_SHARE,
    MountCandidate,
    SeedPairs,
)
from workers.marks.outer_edges import outer_distance_m
from workers.marks.seeds import FrameSeeds, find_seeds, spread_over
from workers.marks.sights import (
    FailureReason,
    Floats,
    FrameSource,
    Lens,
    LikelyPixel,
    MachineMarks,
    MarkProposal,
    MarkRefusal,
    MountedLens,
    RecordingFailure,
    Sight,
    is_in_one_place,
)

FLOOR_M: Final = 0.0008
"""Standard deviation of a corner in the board's plane: cut edges, rims and blunt tips.

On a tripod's chessboard six tips scattered by 0.5 px, 1 mm, about the pattern's extrapolation (pandar40-tripod, which
therefore judges nothing). ISO 2768-1 m allows edges of this length 0.8 mm. Blind marks by hand do not exist yet.
"""
_FLOOR_PX: Final = 0.05  # interpolation and rounding of pixels
_SCATTER: Final = 2.5
"""Variance of a mark against what its profiles' scatter tells: texture behind an edge, a pattern beside it and motion
shift long parts of it alike. This and the next were chosen by 27 development scenes."""
_SHIFT_SHARE: Final = 0.1  # of the edges' softness
_SIDE_VARIANCE: Final = 4.0  # of a side corner against the tip
_OFF_MOUNT: Final = 4.0  # standard scores
_STEP_M: Final = 1e-3
_FEWEST_SIGHTS: Final = 5  # whose edges confirm a mount: three marks determine it
_WAYS: Final = ((16.0, 0.0), (16.0, -0.07), (16.0, -0.14), (8.0, 0.0))
"""Half width of the first profiles, px, and how far outward edges are sought, metres: seeds may have taken a head for
a tip that is 0.1 or 0.2 m lower, and on a small board wide profiles hold more of its pattern than of its edge."""
_MOST_SCATTER: Final = 2.0
"""Of the median standard score against its expectation, 1: four deviations of it for the fewest marks, eight."""
_STILL_CONFIRMED: Final = 0.8  # of the sights, by edges farther out
Answers = list[dict[CornerName, MarkProposal | MarkRefusal]]
_GAIN_STEP: Final = 0.3
_TOLD_BY_SIZE: Final = frozenset({"no_consensus", "few_edges", "two_consensuses", "in_one_place"})
_ENOUGH_TIPS: Final = 0.5  # of the sights: with fewer, the other corners are measured for the mount too


@dataclass(frozen=True, eq=False)
class _TriedMount:
    """A mount after its marks: the best standard score in each sight with a mark, and the edges' median softness."""

    scores: Sequence[float]
    camera: MountedLens
    softness: float

    @property
    def confirmed(self) -> int:
        """Return the number of sights in which a corner was measured where the mount projects it."""
        return sum(score < _OFF_MOUNT for score in self.scores)

    def support(self, scatter: float = 1.0) -> float:
        """Return the support: sights weighted by agreement, for this scatter (MSAC: Torr and Zisserman 2000)."""
        limit = scatter * _OFF_MOUNT
        return sum(1.0 - (score / limit) ** 2 for score in self.scores if score < limit)

    def is_rivalled_by(self, other: _TriedMount) -> bool:
        """Return whether the other mount has enough support, at this mount's scatter, to be a real rival."""
        scatter = min(1.0, _scatter(self.scores))
        return other.support(scatter) >= RIVAL_SHARE * self.support(scatter)


def propose(
    frames: FrameSource,
    sights: Sequence[Sight],
    size: tuple[int, int],
    *,
    lens: Lens | None = None,
    model: ModelName = "brown_conrady",
    corners: Sequence[CornerName] = ("top",),
    upper_corner: int = 0,
    background: Sequence[int] = (),
    on_sight: OnSight = lambda: None,
) -> MachineMarks:
    """A mark, or a reason why not, for each of the asked corners of each sight.

    Args:
        size: width and height of the frames, px.
        lens: as it is stated; None: unknown, of the given model.
        corners: for which marks are wanted. Those that a sight does not know get none.
        upper_corner: which corner ``top`` is on a board with level edges (`workers.marks.seeds.find_seeds`).
        background: frames without a sight. They tell the background where those with one do not.
        on_sight: called before each sight is looked at; it may raise to stop the work.
    """
    task = MarkTask(frames, sights, size, lens, lens.model if lens else model, corners, on_sight)
    fewest = LEAST_PAIRS if lens is None else LEAST_WITH_LENS
    if len(sights) < fewest:
        return _failed(task, "few_poses", f"{len(sights)} corners have a frame; the machine needs {fewest}.")
    of_sights = [sight.frame for sight in sights]
    chosen, every = spread_over(of_sights), spread_over([*of_sights, *background])
    marks = _from_seeds(task, chosen, [find_seeds(frames, chosen, upper_corner)])
    if marks.failure is not None and background:
        marks = _first_found(marks, _from_seeds(task, every, [find_seeds(frames, every, upper_corner)]))
    # Without a lens a search that fails takes a minute, and these seeds fail in every recording without a board.
    for find in (find_chessboard_seeds, find_outline_seeds) if lens is not None else ():
        if marks.failure is not None and (alternatives := find(frames, chosen, upper_corner)):
            marks = _first_found(marks, _from_seeds(task, chosen, alternatives))
    return marks


def _first_found(marks: MachineMarks, others: MachineMarks) -> MachineMarks:
    return marks if others.failure is not None else others


def _from_seeds(task: MarkTask, chosen: Sequence[int], alternatives: Sequence[Sequence[FrameSeeds]]) -> MachineMarks:
    """Find the mount that most seeds agree on, by the best of the alternatives, and mark."""
    clocked = [at_best_clock(task, {of_frame.frame: of_frame for of_frame in seeds}) for seeds in alternatives]
    with_mount = [pairing for pairing in clocked if pairing[2]]
    if not with_mount:
        return _failed(task, *_why_none(alternatives[0], task.lens, task.sights))
    at, pairs, candidates = max(with_mount, key=lambda pairing: pairing[2][0].support)
    return _from_candidates(at, set(chosen), pairs, candidates)


def _from_candidates(
    task: MarkTask, chosen: set[int], pairs: SeedPairs, candidates: Sequence[MountCandidate]
) -> MachineMarks:
    """Edges decide between mounts; two that the edges of many sights confirm are an ambiguity."""
    some = [index for index, sight in enumerate(task.sights) if sight.frame in chosen]
    tried: list[_TriedMount] = []
    for candidate in candidates:
        slots = np.flatnonzero(candidate.explained)
        start = fit_mount(
            candidate.camera, task.lens, pairs.points[slots], pairs.seeds[slots, candidate.nearest[slots]],
            np.ones(len(slots)), task.size,
        )  # fmt: skip
        ways: list[_TriedMount] = []
        for half_width, outward_m in _WAYS:
            measured = measure(task, some, start, ("top",), half_width, 1.0, outward_m=outward_m)
            if _marked(measured) < _ENOUGH_TIPS * len(some):
                measured = measure(task, some, start, CORNERS, half_width, 1.0, outward_m=outward_m)
            camera, softness = _refit(task, measured, start)
            ways.append(_TriedMount(_sight_scores(task, measured, camera), camera, softness))
            if ways[-1].confirmed >= LEAST_SHARE * len(some):
                break
        tried.append(max(ways, key=_TriedMount.support))
    tried.sort(key=_TriedMount.support, reverse=True)
    best = tried[0]
    camera, softness = best.camera, best.softness
    if best.confirmed < max(_FEWEST_SIGHTS, LEAST_SHARE * len(some)):
        sentence = f"The board's edges were found in {best.confirmed} of {len(some)} frames only."
        return _failed(task, "few_edges", sentence)
    rivals = [other for other in tried[1:] if _apart_px(task, camera, other.camera) > INLIER_PX]
    if rivals and best.is_rivalled_by(rivals[0]):
        return _failed(
            task,
            "two_consensuses",
            f"Two mounts explain the frames, one {best.confirmed} of them and another {rivals[0].confirmed}: does a "
            "second person walk along, or is the board's pattern repeated?",
        )
    everything = range(len(task.sights))
    changes: list[Floats] = []
    besides: dict[CornerKey, Beside] = {}
    measured = measure(task, everything, camera, task.corners, 8.0, softness, changes=changes, besides=besides)
    camera, softness = _refit(task, measured, camera)
    by_marks = at_marked_clock(task, measured, camera)
    if by_marks.offset_s != task.offset_s:
        task = by_marks
        changes, besides = [], {}
        measured = measure(task, everything, camera, task.corners, 8.0, softness, changes=changes, besides=besides)
        camera, softness = _refit(task, measured, camera)
    outward_m = outer_distance_m(changes)
    if outward_m > 0.0:
        outer = measure(task, everything, camera, task.corners, 4.0, softness, outward_m=outward_m)
        moved, softness = _refit(task, outer, camera)
        outer_besides: dict[CornerKey, Beside] = {}
        outer = measure(task, everything, moved, task.corners, 4.0, softness, besides=outer_besides)
        moved, _ = _refit(task, outer, moved)
        farther = _TriedMount(_sight_scores(task, outer, moved), moved, softness)
        nearer = _TriedMount(_sight_scores(task, measured, camera), camera, softness)
        if farther.confirmed >= _STILL_CONFIRMED * nearer.confirmed:
            measured, camera, besides = outer, moved, outer_besides
    scatter = _scatter(list(_scores(task, measured, camera).values()))
    if scatter > _MOST_SCATTER:
        return _failed(
            task,
            "few_edges",
            f"The marks scatter {scatter:.1f} times as much about one mount as they should: in some frames the edges "
            "of the board were found, in others lines of its pattern.",
        )
    mixtures = with_alternatives(measured, besides)
    answers = _answers(task, mixtures, camera)
    return MachineMarks(answers, _refit(task, mixtures, camera)[0], offset_s=task.offset_s)


def _marked(measured: dict[int, Measured]) -> int:
    return sum(any(isinstance(corner, CornerFit) for corner in corners.values()) for corners in measured.values())


def _sight_scores(task: MarkTask, measured: dict[int, Measured], camera: MountedLens) -> list[float]:
    """The best standard score of a corner in each sight with a mark."""
    best: dict[int, float] = {}
    for (index, _), score in _scores(task, measured, camera).items():
        best[index] = min(score, best.get(index, np.inf))
    return list(best.values())


def _apart_px(task: MarkTask, camera: MountedLens, other: MountedLens) -> float:
    """Median distance of the tips' projections by two cameras."""
    tips = np.array([sight.corners["top"] for sight in task.sights])
    return float(np.nanmedian(np.hypot(*(camera.pixels(tips) - other.pixels(tips)).T)))


def _refit(task: MarkTask, measured: dict[int, Measured], camera: MountedLens) -> tuple[MountedLens, float]:
    """The camera after its marks, and the median softness of the edges."""
    fits = [
        (task.sights[index].corners[name], fit, 1.0 if name == "top" else 1.0 / _SIDE_VARIANCE)
        for index, corners in measured.items()
        for name, fit in corners.items()
        if isinstance(fit, CornerFit)
    ]
    if not fits:
        return camera, 1.0
    points, marks = np.array([point for point, _, _ in fits]), np.array([fit.pixel for _, fit, _ in fits])
    again = fit_mount(camera, task.lens, points, marks, np.array([weight for _, _, weight in fits]), task.size)
    return again, float(np.median([fit.softness_px for _, fit, _ in fits]))


def _answers(task: MarkTask, mixtures: dict[int, Measured], camera: MountedLens) -> Answers:
    """Proposals of the asked corners. A mark far from its mount's projection, as such marks go, is none.

    Other edges excuse no distance from the mount: it is judged without what they add to the covariance.
    """
    measured: dict[int, Measured] = {
        index: {
            name: fit._replace(ambiguity=np.zeros((2, 2))) if isinstance(fit, CornerFit) else fit
            for name, fit in corners.items()
        }
        for index, corners in mixtures.items()
    }
    scores = _scores(task, measured, camera)
    scale = max(1.0, _scatter(list(scores.values())))
    answers: Answers = []
    for index, sight in enumerate(task.sights):
        of_sight: dict[CornerName, MarkProposal | MarkRefusal] = {}
        for name in task.corners:
            fit = mixtures[index].get(name)
            if isinstance(fit, CornerFit):
                off = scores[index, name] > _OFF_MOUNT * scale
                of_sight[name] = MarkRefusal("off_mount") if off else _proposal(sight, name, fit, camera)
            elif fit is not None:
                of_sight[name] = MarkRefusal(fit)
        answers.append(of_sight)
    return answers


def _proposal(sight: Sight, name: CornerName, fit: CornerFit, camera: MountedLens) -> MarkProposal | MarkRefusal:
    u, v = fit.pixel.tolist()
    ends = sight.neighbours(name)
    assert ends is not None
    lengths = np.hypot(*(camera.pixels(ends) - fit.pixel).T)
    if fit.second is not None:
        pixel, weight = fit.second
        places = LikelyPixel(u, v, 1.0 - weight), LikelyPixel(float(pixel[0]), float(pixel[1]), weight)
        return MarkRefusal("two_places", places, float(lengths.min()))
    return MarkProposal((u, v), _stated_covariance(fit, _by_point(sight.corners[name], camera)), float(lengths.min()))


def _by_point(point: Floats, camera: MountedLens) -> Floats:
    """Derivative (2, 3) of a point's pixel, px per metre."""
    around = camera.pixels(np.vstack([point, point + _STEP_M * np.eye(3)]))
    return (around[1:] - around[0]).T / _STEP_M


def _stated_covariance(fit: CornerFit, J: Floats) -> Floats:
    px_per_m = float(np.linalg.norm(J, 2))
    floor = _FLOOR_PX**2 + (_SHIFT_SHARE * fit.softness_px) ** 2 + (FLOOR_M * px_per_m) ** 2
    return _SCATTER * fit.covariance + fit.ambiguity + floor * (np.eye(2) + fit.extrapolation)


def _scores(
    task: MarkTask, measured: dict[int, Measured], camera: MountedLens
) -> dict[tuple[int, CornerName], float]:
    """Distances of the marks from the projections of their vertices, in standard deviations of both."""
    return {
        (index, name): _standard_score(task.sights[index], name, fit, camera)
        for index, corners in measured.items()
        for name, fit in corners.items()
        if isinstance(fit, CornerFit)
    }


def _scatter(scores: Sequence[float]) -> float:
    """The median score against its expectation, that of Rayleigh's distribution; 0 without marks."""
    return float(np.median(scores)) / math.sqrt(2.0 * math.log(2.0)) if scores else 0.0


def _standard_score(sight: Sight, name: CornerName, fit: CornerFit, camera: MountedLens) -> float:
    J = _by_point(sight.corners[name], camera)
    lidar = (1.0 if name == "top" else _SIDE_VARIANCE) * (sight.covariance + SHAPE_M**2 * np.eye(3))
    rest = fit.pixel - camera.pixels(sight.corners[name][None])[0]
    if not np.all(np.isfinite(J)):
        return np.inf
    spread = J @ lidar @ J.T + _stated_covariance(fit, J)
    scaled: Floats = np.asarray(np.linalg.solve(spread, rest), np.float64)
    return float(np.sqrt(rest @ scaled))


def _why_none(seeds: Sequence[FrameSeeds], lens: Lens | None, sights: Sequence[Sight]) -> tuple[FailureReason, str]:
    """The likeliest reason for no consensus, in a sentence."""
    if is_in_one_place(sights):
        hides = "hides" if any(len(sight.corners) > 1 for sight in sights) else "may hide"
        return (
            "in_one_place",
            f"The board {hides} the same part of the background in more than half of the frames, so that the machine "
            "cannot tell the two apart: move it by its own width between poses.",
        )
    empty = sum(not frame.pixels for frame in seeds)
    if empty > (1.0 - LEAST_SHARE) * len(seeds):
        return (
            "background_colour",
            f"In {empty} of {len(seeds)} frames nothing differs from the background: the board may have its colour.",
        )
    gains = [frame.gain for frame in seeds]
    if max(gains) > (1.0 + _GAIN_STEP) * min(gains):
        return (
            "exposure",
            f"The frames' brightness changes by a factor of {max(gains) / min(gains):.1f}, and no mount explains "
            "what differs between them: lock the camera's exposure.",
        )
    crowded = sum(frame.rivals > 0 for frame in seeds)
    others = f" In {crowded} frames more than one thing moves." if crowded > 0.3 * len(seeds) else ""
    unknown = " State the camera's lens (--intrinsics FILE, or on the recording's page)." if lens is None else ""
    return "no_consensus", f"No mount explains where things move in {len(seeds)} frames.{others}{unknown}"


def _failed(task: MarkTask, reason: FailureReason, sentence: str) -> MachineMarks:
    none: Answers = [
        {name: MarkRefusal("no_mount") for name in task.corners if name in sight.corners} for sight in task.sights
    ]
    if reason in _TOLD_BY_SIZE and all(len(sight.corners) == 1 for sight in task.sights):
        sentence += " With the board's size (--board) the machine uses its other corners too."
    return MachineMarks(none, None, RecordingFailure(reason, sentence + " Mark this recording by hand."))
