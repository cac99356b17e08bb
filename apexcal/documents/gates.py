"""A gate: what a result must show to be published without an override; and the verdict on one result."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apexcal.documents.base import Document, Received

_Most = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Share = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]


class Gate(Received):
    """Limits, each optional. A rig's limit replaces the fleet's of the same name.

    Upper limits: ``heldout_mean_px`` of the mean error of held-out pairs; ``std_deg`` and ``std_mm`` of the largest
    standard deviation of a turn and of a component of the translation; ``halves_ratio`` of the difference of halves
    of the pairs over what is stated. Lower limit: ``coverage``, the share of the image's 8 x 6 equal cells that hold
    a pair.
    """

    heldout_mean_px: _Most | None = None
    std_deg: _Most | None = None
    std_mm: _Most | None = None
    halves_ratio: _Most | None = None
    coverage: _Share | None = None


class GateCheck(Document):
    """One limit of a gate, checked on a result; ``measured`` is null if the result lacks the measure."""

    name: str
    limit: float
    measured: float | None
    passed: bool
    stated_by: Literal["fleet", "rig"]
    reason: str | None = None


class GateVerdict(Document):
    """Whether a result passed, limit by limit, when it was published."""

    passed: bool
    checks: list[GateCheck]
