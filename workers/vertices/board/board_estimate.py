"""The board that a plane's rays imply: where its apex is, how it is held, and how well the rays agree with it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from workers.vertices.board.candidate import HARDLY, Plane, probability_within
from workers.vertices.board.model import MOST_ROLL_RAD, Floats

_LEAST_LIKELY, _TIMES_EXPECTED = -1.0, 1.5
# A return contradicts an unrelated board one time in two.
_BY_CHANCE = 0.5
# On few rings a board has too few returns to show its own share of contradictions. The limit is half of `_BY_CHANCE`.
_CONTRADICTED = 0.25
# Doors and cars have upright edges, and up is known to 4 degrees. A board of 1 : 1.6 hangs at 32 degrees and is
# rolled by up to 20, so its edges are at least 12 degrees from upright. The limit lies half way from 4 to 12.
_UPRIGHT = math.radians(8.0)
MOST_ON_BOARD = 0.5
_TRUSTED_RAD = math.radians(0.3)


class Contradictions(NamedTuple):
    """Counts of the returns that contradict a board, and of all returns, in its plane or at its edges."""

    contradicting: int
    returns: int


class PosteriorMode(NamedTuple):
    """One of the posterior's two modes: either edge may be the one to the lower left.

    Attributes:
        weight: share of the posterior.
        edges: metres, to the lower left and to the lower right.
        mean: (3,) apex to the left and up (m), and the fall of the edge to the lower left (rad).
        covariance: (3, 3) of these.
    """

    weight: float
    edges: tuple[float, float]
    mean: Floats
    covariance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class HoldEstimate:
    """How the board is held in one sweep.

    Attributes:
        roll, roll_sigma: radians from the rest angle, and its standard deviation.
        fall: radians by which the edge to the lower left falls.
        modes: of the posterior, without errors that all sweeps share.
        roll_log_likelihood: (2, G) log likelihood of the rays at each of `ROLLS`. The edge to the lower left is the
            board's first one in row 0 and the second one in row 1. Values are minus infinity far from the likeliest
            rolls, and in a mode that is much less likely than the other.
    """

    roll: float
    roll_sigma: float
    fall: float
    modes: tuple[PosteriorMode, ...]
    roll_log_likelihood: Floats

    @property
    def likeliest(self) -> PosteriorMode:
        """Return the mode with the largest weight."""
        return max(self.modes, key=lambda mode: mode.weight)


@dataclass(frozen=True, slots=True, eq=False)
class BoardAgreement:
    """How well the rays agree with the likeliest board in their plane.

    Attributes:
        returns: contradictions among the returns in its plane, above and below the board's side corners. In-plane
            returns beyond the outline contradict the board; so do returns off the plane within it.
        at_edges: as `returns`, for the rays at the edges alone.
        on_board_share: share of the returns in its plane that lie on the board itself, not in the rim that blooming
            adds.
        moving_share: of a board with level edges, the share of its returns that lie in the region and are not static.
        wrong: share of the returns that contradict this recording's boards, above and below their side corners.
        best: log likelihood of the rays for the likeliest board, 0 if every ray is as expected.
        expected: this log likelihood if the board is there and the sensor is as learned.
        evidence: log of the rays' likelihood, averaged over the prior.
    """

    returns: tuple[Contradictions, Contradictions]
    at_edges: tuple[Contradictions, Contradictions]
    on_board_share: float
    moving_share: float
    wrong: tuple[float, float]
    best: float
    expected: float
    evidence: float

    @property
    def contradicting(self) -> int:
        """Return how many returns contradict the board."""
        return sum(part.contradicting for part in self.returns)


@dataclass(frozen=True, slots=True, eq=False)
class BoardEstimate:
    """The board that a plane's rays imply.

    Attributes:
        plane: the board's plane.
        xyz: (3,) metres, LiDAR frame: its apex.
        covariance: (3, 3) of azimuth, elevation (rad) and range (m) of the apex.
        sigma: radians, standard deviation, azimuth and elevation together, from the sweep's own rays: without errors
            that all sweeps share.
        hold: roll and posterior.
        agreement: how well the rays agree with the board.
        upper_corner: see `BoardModel.upper_corner`.
    """

    plane: Plane
    xyz: Floats
    covariance: Floats
    sigma: float
    hold: HoldEstimate
    agreement: BoardAgreement
    upper_corner: int

    @property
    def is_consistent(self) -> bool:
        """Return whether the returns agree with a board that somebody may hold like this.

        On few rings the rays must also be nearly as likely as noise alone makes them. On more rings a real board's
        rays are less likely than that, because boards bend and hands hold them. There the number of contradictions
        decides: this recording's boards must explain it better than chance does. On any number of rings most
        returns must lie on the board, not in the rim that a beam's width adds to it.
        """
        agreement, extent = self.agreement, self.plane.extent
        if not self.has_usual_hold or agreement.on_board_share < MOST_ON_BOARD:
            return False
        if not extent.has_many_rings:
            is_as_learned = agreement.best >= _LEAST_LIKELY + _TIMES_EXPECTED * agreement.expected
            contradicting = agreement.contradicting
            return is_as_learned and contradicting < _CONTRADICTED * (extent.points + contradicting)
        return sum(map(_board_log_odds, agreement.returns, agreement.wrong)) > 0.0

    @property
    def is_consistent_above(self) -> bool:
        """Return whether the returns above the side corners agree with a board.

        Below these corners a body may lie in the board's plane.
        """
        above = _board_log_odds(self.agreement.returns[0], self.agreement.wrong[0])
        return self.has_usual_hold and self.plane.extent.has_many_rings and above > 0.0

    @property
    def has_usual_hold(self) -> bool:
        """Return whether a person may hold a board in this way.

        Rolled farther than people roll boards, it is held by another corner than is stated. On rings the test against
        upright rectangles shows that of tips. Doors, cars and walls have upright edges; a board with a tip has none.
        """
        hold = self.hold
        is_rolled = probability_within(MOST_ROLL_RAD, hold.roll, hold.roll_sigma**2) <= HARDLY
        if not self.plane.has_usual_slopes or (is_rolled and (self.upper_corner or not self.plane.extent.rings)):
            return False
        if self.upper_corner:
            return True
        most = math.radians(45.0) - _UPRIGHT
        likely = [
            mode.weight
            * probability_within(most, float(mode.mean[2]) - math.radians(45.0), float(mode.covariance[2, 2]))
            for mode in hold.modes
        ]
        return sum(likely) > HARDLY

    @property
    def is_trustworthy(self) -> bool:
        """Return whether neighbouring sweeps and learning may use this board."""
        return self.is_consistent and not self.plane.extent.is_like_a_person and self.sigma < _TRUSTED_RAD

    @property
    def joint_evidence(self) -> float:
        """Return the log likelihood of points and rays together. It compares planes of one sweep."""
        return self.agreement.evidence + self.plane.score

    @property
    def sigma_azimuth(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[0, 0])

    @property
    def sigma_elevation(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[1, 1])


def _board_log_odds(counts: Contradictions, wrong: float) -> float:
    """Return the log odds of board against chance, if a share ``wrong`` of a board's returns contradicts it."""
    on_board = counts.returns * math.log((1.0 - wrong) / (1.0 - _BY_CHANCE))
    return on_board - counts.contradicting * math.log(_BY_CHANCE / wrong)
