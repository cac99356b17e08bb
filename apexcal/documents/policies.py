"""The publication policy of a fleet or rig: what a result must show to be published."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from apexcal.documents.base import Received
from apexcal.documents.checks import CheckVerdict

_Most = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Share = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]


class PublicationPolicy(Received):
    """Limits, each optional, and what is published without a person. A rig's member replaces the fleet's.

    Upper limits: ``heldout_mean_px`` of the mean error of held-out pairs; ``std_deg`` and ``std_mm`` of the largest
    standard deviation of a turn and of a component of the translation; ``halves_ratio`` of the difference of halves
    of the pairs over what is stated. Lower limit: ``coverage``, the share of the image's 8 x 6 equal cells that hold
    a pair. ``publish_looks``: whether a result with a check of ``look`` is published by itself too, where that was
    asked for; otherwise only one that passes all checks.
    """

    heldout_mean_px: _Most | None = None
    std_deg: _Most | None = None
    std_mm: _Most | None = None
    halves_ratio: _Most | None = None
    coverage: _Share | None = None
    publish_looks: bool | None = None

    def publishes(self, verdict: CheckVerdict) -> bool:
        """Whether a recommended result with this verdict is published by itself."""
        return verdict == "pass" or (verdict == "look" and bool(self.publish_looks))
