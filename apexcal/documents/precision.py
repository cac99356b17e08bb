"""The precision of a fit's parameters: deviations, what pairs share, and how well points are predicted."""

from __future__ import annotations

from typing import Final, Literal

from apexcal.documents.base import Document

# By parameter name; null where the pairs do not determine it.
Deviations = dict[str, float | None]


class Covariance(Document):
    """The free parameters' covariance: degrees, metres, pixels; rotations are small turns about the camera's axes."""

    names: list[str]
    units: list[str]
    matrix: list[list[float]]


class WorstCorrelation(Document):
    """The two parameters that can be told apart least."""

    pair: list[str]
    value: float


# The points of a field. Stored fields hold these numbers: neither the steps nor their order may change.
FIELD_STEP_DEG: Final = 10
FIELD_RANGES_M: Final = (5.0, 20.0)
FIELD_ELEVATIONS_DEG: Final = tuple(range(FIELD_STEP_DEG - 90, 90, FIELD_STEP_DEG))
FIELD_AZIMUTHS_DEG: Final = tuple(range(-180, 180, FIELD_STEP_DEG))


class Field(Document):
    """Where a result projects fixed points around the LiDAR that the image shows, and its deviation there, pixels.

    The points are the same for all results: every 10 degrees of azimuth and elevation, 5 and 20 m away. ``number``
    identifies a point: it counts ranges, then elevations, then azimuths.
    """

    number: list[int]
    u: list[float]
    v: list[float]
    sigma_px: list[float]


class OverTime(Document):
    """The errors that stretches of a walk share, besides those of its groups (the corners of a sweep).

    ``widening``: the deviations of pixels over the marks, divided by those if groups erred independently.
    """

    blocks: int
    shift_px: float
    evidence: float
    counted: bool
    widening: float


class SharedErrors(Document):
    """The errors that pairs of a block share: of a ``group`` named by the pairs, or of a walk (``time``, ``order``).

    ``deviations`` from block to block: ``offset_m`` and ``turn_deg`` of a group, ``shift_px`` of a stretch.
    ``noise_px`` is each mark's own noise. ``evidence`` is twice the log likelihood ratio to independent errors.
    ``widening``: the deviations of pixels over the marks, divided by those of independent errors. The result's
    deviations include the shared errors if ``counted``. ``over_time`` is there if many groups are in stretches.
    """

    blocks: int
    by: Literal["group", "time", "order"]
    deviations: dict[str, float]
    noise_px: float
    evidence: float
    counted: bool
    widening: float
    over_time: OverTime | None


class Halves(Document):
    """The difference of fits of two disjoint halves: every second block and the others, or the first and last ones.

    Each ratio compares a difference with its stated size under the fit to all pairs: ``ratio`` over the parameters,
    ``field_ratio`` over the marks, ``turned_ratio`` of a turn of the mount alone (``turned_deg``). By chance
    one in 1000 sound results exceeds each limit.
    """

    split: Literal["alternating", "first_and_last"]
    pairs: list[int]
    ratio: float
    limit: float
    rotation_deg: float
    translation_mm: float
    field_px: float
    stated_px: float
    field_ratio: float
    field_limit: float
    turned_deg: float | None
    turned_ratio: float | None
    turned_limit: float | None
    holds: bool


class PersonBias(Document):
    """The standard deviation of one person's bias along each axis, its degrees of freedom, and how many people there
    are.
    """

    px: float
    freedom: float
    people: int


class FittedOffset(Document):
    """The camera's clock minus what the pairs were made with, as a fit estimates it with the mount."""

    offset_ms: float
    std_ms: float


class RollingShutter(Document):
    """The line time (from an image row to the next) that residuals show beyond the stated one, and its deviation.

    ``shown``: their ratio exceeds ``limit``, which one in 200 sound results does by chance.
    """

    line_time_us: float
    std_us: float
    limit: float
    shown: bool


StepKind = Literal["lens", "board", "person", "marks"]


class NextStep(Document):
    """A step that narrows the mount's 95 % interval, and the largest half widths to expect after it."""

    kind: StepKind
    words: str
    half_width_deg: float
    half_width_mm: float


class NextSteps(Document):
    """The parts of the mount's widest 95 % interval, and the next steps, the best first.

    ``parts``: the half width with each error alone, in degrees, or in mm if the shifts are wider over their limit.
    """

    half_width_deg: float
    half_width_mm: float
    parts: dict[str, float]
    steps: list[NextStep]


class PredictedPixel(Document):
    """Deviations of a point that projects to this pixel, by distance; null if the lens has no ray there."""

    u: float
    v: float
    stated_px: list[float] | None
    stated_mm: list[float] | None


class Prediction(Document):
    """The precision of the LiDAR's points in the image: one standard deviation, under the fitted model.

    ``expected_over_stated`` is the factor by which to enlarge them if halves of the pairs differ by more than is
    stated.
    """

    distances_m: list[float]
    expected_over_stated: float
    points: list[PredictedPixel]

    def middle_at(self, distance_m: float) -> tuple[float, float] | None:
        """Return the deviation to expect in the middle of the image at one of the distances, in pixels and mm.

        None if the lens has no ray there.
        """
        middle, index = self.points[len(self.points) // 2], self.distances_m.index(distance_m)
        if not middle.stated_px or not middle.stated_mm:
            return None
        factor = self.expected_over_stated
        return factor * middle.stated_px[index], factor * middle.stated_mm[index]


class Precision(Document):
    """The precision of the free parameters, in degrees, metres and pixels.

    Deviations and half widths are null where the pairs do not determine the parameter. ``sigma_px`` is the noise of a
    typical pair.
    """

    std: Deviations
    interval95_half_width: Deviations
    covariance: Covariance
    sigma_px: float


class FitPrecision(Precision):
    """The precision of a whole fit.

    ``noise_scale`` says how many times larger the errors are than stated, where pairs weigh by what they state.
    ``rank`` and ``condition`` are those of the Jacobian with columns of unit length; the condition is null unless the
    rank is full. ``undetermined`` has the largest parts of each direction that the pairs leave open.
    ``degrees_of_freedom`` are those of each deviation, where what pairs share counts in it.
    """

    correlation: list[list[float]]
    worst_correlation: WorstCorrelation | None
    noise_scale: float | None
    rank: int
    condition: float | None
    undetermined: list[dict[str, float]]
    degrees_of_freedom: Deviations | None
