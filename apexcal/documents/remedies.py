"""Requests and answers about tried remedies: what each would bring on held-out pairs."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.base import Document, Received, Stored
from apexcal.documents.checks import CheckVerdict

TrialOutcome = Literal["helps", "alike", "harms", "unknown"]


class RemediesRequest(Received):
    """Try what the checks of a result advise. It must be a fit to all pairs."""

    kind: Literal["remedies"]
    result_id: UUID


class RemedyTrial(Document):
    """The effect of the remedy of one ``check`` on the pairs of this result, and a ``sentence``.

    ``noise_px``: of held-out pairs per coordinate, with the remedy and without it (``before``); ``log_likelihood`` of
    these pairs (with its standard error): how much higher it is with the remedy. ``moved_px``: how far 95 % of the
    fitted corners' projections move at most. ``verdict``: the gravest of the fit's checks with it. Null where nothing
    could be held out.
    """

    check: str
    outcome: TrialOutcome
    sentence: str
    noise_px: float | None = None
    noise_before_px: float | None = None
    log_likelihood: float | None = None
    standard_error_log_likelihood: float | None = None
    moved_px: float | None = None
    verdict: CheckVerdict | None = None


class TriedRemedies(Document):
    """The trials, the most helpful first. ``advice``: the check whose remedy to follow; null if none helps."""

    trials: list[RemedyTrial]
    advice: str | None


class RemediesView(AnalysisView):
    """Remedies of a result's checks, tried."""

    kind: Literal["remedies"]
    result: Stored[TriedRemedies | None]
