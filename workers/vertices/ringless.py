"""Boards of sensors without rings, solid-state ones for instance, on still poses.

A board is looked for in each sweep. Sweeps in a row whose boards agree, plane and corners, are one pose. Its points
are put together, and judged as a sweep with rings is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from apexcal.documents.errors import InputError
from workers.readers.clouds.ring_spread import RINGLESS
from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import BoardEstimate
from workers.vertices.board.estimate import find_boards
from workers.vertices.board.learning import learn
from workers.vertices.board.model import BoardModel
from workers.vertices.board.refined import run
from workers.vertices.board.surroundings import is_overtopped
from workers.vertices.corners import corner_chi_square
from workers.vertices.motion import count_steps
from workers.vertices.pose_detection import AGREE, FIXED_M
from workers.vertices.region import Region
from workers.vertices.static_background import FIXED_SHARE, Foreground, StaticBackground
from workers.vertices.still_poses import STANDS_M
from workers.vertices.sweep_source import Listed, OnSweep, Scattered, SweepSource, stamp_of
from workers.vertices.vertex import Answers, PoseFacts, Rejection, Vertex

Mask = NDArray[np.bool_]
_COMPARED: Final = 12  # sweeps
_PLANES: Final = 3
_MOST_POINTS: Final = 20_000  # of a pose
_LEAST_SHARE: Final = 0.25  # of the usual length of a pose
_LEAST_NS: Final = 500_000_000  # of a pose: half a second
_MOST: Final = 0.51  # more than half of the poses: two boards of few poses may touch by chance


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Sweeps in a row that show a board: their points together, which of these may be the board's, and the board."""

    numbers: range
    sweep: Sweep
    inside: Mask
    board: BoardEstimate

    def with_next(self, other: _Block, model: BoardModel) -> _Block | None:
        """Return both blocks together, if they show the same board; else None."""
        if corner_chi_square(self.board, other.board, FIXED_M / AGREE**0.5) > AGREE:
            return None
        parts = self.sweep, other.sweep
        inside = np.concatenate([self.inside, other.inside])
        some = slice(None, None, -(-len(inside) // _MOST_POINTS))
        xyz, intensity, ring, offset_ns = (
            np.concatenate([getattr(part, name) for part in parts])[some]
            for name in ("xyz", "intensity", "ring", "offset_ns")
        )
        sweep = replace(self.sweep, xyz=xyz, intensity=intensity, ring=ring, offset_ns=offset_ns)
        board = _board(sweep, inside[some], model)
        numbers = range(self.numbers.start, other.numbers.stop)
        return None if board is None else _Block(numbers, sweep, inside[some], board)


def run_ringless(
    source: SweepSource, region: Region, options: Options, indices: range, still: bool, on_sweep: OnSweep
) -> tuple[Answers, PoseFacts]:
    """Return one vertex for each still pose, in its middle sweep, and how many poses there are.

    Raises:
        InputError: ``points_without_rings`` if poses are not stated to be still, or the board moves all the time.
    """
    if not still:
        raise _needs_poses("the recording is not stated to be of still poses")
    scattered = Scattered(source)

    def report() -> None:
        on_sweep(indices.start)  # it may end the work

    background = StaticBackground.of(scattered, _COMPARED, report)
    moving = Foreground.of(region, background, FIXED_SHARE)
    model = learn(scattered, moving, options, report)
    if model is None:
        inside = (region.inside(source.sweep(index)).any() for index in indices)
        return Answers([Rejection("size_not_stated" if some else "no_points") for some in inside]), PoseFacts(0, True)
    blocks: list[_Block] = []
    for area in (moving, region):  # in a single pose nothing moves
        for index in range(len(scattered)) if not blocks else ():
            sweep = scattered.sweep(index)
            chosen = area.inside(sweep)
            board = _board(sweep, chosen, model)
            blocks += [] if board is None else [_Block(range(index, index + 1), sweep, chosen, board)]
            report()
    every = _join_blocks(blocks, model)
    lengths = [len(block.numbers) for block in every]
    least = _LEAST_SHARE * float(np.median(np.repeat(lengths, lengths))) if lengths else 0.0
    poses = [block for block in every if len(block.numbers) >= least]
    lasting_ns = [stamp_of(source, pose.numbers[-1]) - stamp_of(source, pose.numbers[0]) for pose in poses]
    passing = bool(poses) and float(np.median(lasting_ns)) < _LEAST_NS
    if passing and _walked([(stamp_of(source, pose.numbers[0]), pose.board) for pose in poses]):
        raise _needs_poses("the board moves from sweep to sweep")
    outcomes: dict[int, Vertex | Rejection] = {}
    for block in every:
        outcomes |= dict.fromkeys(
            block.numbers, Rejection("same_pose" if len(block.numbers) >= least else "not_still")
        )
    alone = [index for index in range(len(scattered)) if index not in outcomes]
    middles = [block.numbers[len(block.numbers) // 2] for block in poses]
    sweeps = [replace(block.sweep, stamp_ns=stamp_of(source, k)) for block, k in zip(poses, middles, strict=True)]
    together = Scattered(Listed([*sweeps, *(source.sweep(index) for index in alone)]))
    others = StaticBackground.of(together)
    area = Foreground.of(region, others, _MOST, len(poses) > 1)
    each = run(together, area, {**options, "track": 0.0}, range(len(together)), lambda _: report(), model).outcomes
    for block, middle, outcome in zip(poses, middles, _reject_immovable(each[: len(poses)]), strict=True):
        outcomes |= {middle: outcome} if isinstance(outcome, Vertex) else dict.fromkeys(block.numbers, outcome)
    # A board that no sweep shows by itself is none.
    outcomes |= {
        index: Rejection("not_a_board") if isinstance(outcome, Vertex) else outcome
        for index, outcome in zip(alone, each[len(poses) :], strict=True)
    }
    answers = [
        replace(outcome, sweep_index=index) if isinstance(outcome, Vertex) else outcome
        for index, outcome in sorted(outcomes.items())
    ]
    return Answers(answers[indices.start : indices.stop]), PoseFacts(max(len(poses), 1), True)


def _needs_poses(why: str) -> InputError:
    return InputError("points_without_rings", f"The LiDAR has no rings, and {why}.", RINGLESS)


def _board(sweep: Sweep, inside: Mask, model: BoardModel) -> BoardEstimate | None:
    """Return the likeliest board of a sweep, if its returns agree with it."""
    if not inside.any():
        return None
    for candidate, board in find_boards(sweep, inside, model, _PLANES):
        if board.is_trustworthy and not is_overtopped(candidate, board, model):
            return board
    return None


def _join_blocks(blocks: list[_Block], model: BoardModel) -> list[_Block]:
    """Return the blocks with agreeing neighbours joined two by two, and again: a longer block is known better."""
    while True:
        joined: list[_Block] = []
        is_open = False
        for block in blocks:
            both = joined[-1].with_next(block, model) if is_open else None
            joined[-1:] = [both] if both is not None else [*joined[-1:], block]
            is_open = both is None
        if len(joined) == len(blocks):
            return joined
        blocks = joined


def _walked(boards: Sequence[tuple[int, BoardEstimate]]) -> bool:
    """Return whether the board moves on from pose to pose as somebody who walks."""
    steps = count_steps([(stamp_ns, *board.xyz[:2].tolist()) for stamp_ns, board in boards])
    return steps.walks > steps.jumps and steps.way_m >= STANDS_M


def _reject_immovable(outcomes: Sequence[Vertex | Rejection]) -> list[Vertex | Rejection]:
    """Return the answers without vertices of what stands at one place in several poses that are no neighbours."""
    answers = list(outcomes)
    vertices = [(number, vertex) for number, vertex in enumerate(outcomes) if isinstance(vertex, Vertex)]
    for k, (number, vertex) in enumerate(vertices):
        for j, (other, also) in enumerate(vertices[:k]):
            if _at_one_place(also, vertex):
                answers[number] = Rejection("same_pose" if j == k - 1 else "nothing_differs")
                answers[other] = answers[other] if j == k - 1 else Rejection("nothing_differs")
    return answers


def _at_one_place(first: Vertex, other: Vertex) -> bool:
    """Return whether all corners that both vertices state are nearer to each other than a standing person sways."""
    places: list[dict[str, NDArray[np.float64]]] = []
    for vertex in (first, other):
        more = dict(zip(vertex.corners.names, vertex.corners.xyz, strict=True)) if vertex.corners else {}
        places.append({"top": np.array(vertex.xyz), **{name: np.array(xyz) for name, xyz in more.items()}})
    common = places[0].keys() & places[1].keys()
    return max(float(np.linalg.norm(places[0][name] - places[1][name])) for name in common) <= FIXED_M
