"""Requests for, and answers about, a fit to a camera's present marks."""

from __future__ import annotations

from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.base import Document, Received, Stored
from apexcal.documents.checks import Check
from apexcal.documents.precision import NextSteps


class PrecisionRequest(Received):
    """Ask how good the calibration of a detection's marks in one camera would be now."""

    kind: Literal["precision"]
    detection_id: UUID
    camera: Annotated[str, Field(max_length=200)]


class MarkingPrecision(Document):
    """The precision that a fit to ``pairs`` of ``answered`` vertices states, and what would improve it.

    ``error_20m_mm``: one standard deviation 20 m away in the middle of the image. ``doubts``: the checks of the fit
    that say ``look`` or ``stop``, the gravest first; if there is none, the marks are enough.
    """

    answered: int
    pairs: int
    error_20m_mm: float | None
    doubts: list[Check]
    next_steps: NextSteps | None


class PrecisionView(AnalysisView):
    """How good the calibration would be. While a newer fit is under way, ``result`` is the earlier fit's."""

    kind: Literal["precision"]
    result: Stored[MarkingPrecision | None]
    camera: str
