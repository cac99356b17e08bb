"""Every kind of analysis, told apart by ``kind``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apexcal.documents.analyses import (
    OffsetRequest,
    OffsetView,
    PreviewRequest,
    PreviewView,
    ReportRequest,
    ReportView,
    SuggestionRequest,
    SuggestionView,
)
from apexcal.documents.base import Page
from apexcal.documents.copies import CopyRequest, CopyView
from apexcal.documents.machine_marks import MarksRequest, MarksView
from apexcal.documents.marking_precision import PrecisionRequest, PrecisionView
from apexcal.documents.pixel_points import PixelPointsRequest, PixelPointsView
from apexcal.documents.remedies import RemediesRequest, RemediesView
from apexcal.documents.validations import (
    PairValidationRequest,
    PairValidationView,
    RoadValidationRequest,
    RoadValidationView,
)

AnalysisKind = Literal[
    "preview",
    "suggestion",
    "clock_offset",
    "calibrated_copy",
    "machine_marks",
    "precision",
    "pixel_points",
    "report",
    "remedies",
    "pair_validation",
    "lane_validation",
    "edge_validation",
]
AnalysisRequest = Annotated[
    PreviewRequest
    | SuggestionRequest
    | OffsetRequest
    | CopyRequest
    | MarksRequest
    | PrecisionRequest
    | PixelPointsRequest
    | ReportRequest
    | RemediesRequest
    | PairValidationRequest
    | RoadValidationRequest,
    Field(discriminator="kind"),
]
AnyAnalysis = Annotated[
    PreviewView
    | SuggestionView
    | OffsetView
    | CopyView
    | MarksView
    | PrecisionView
    | PixelPointsView
    | ReportView
    | RemediesView
    | PairValidationView
    | RoadValidationView,
    Field(discriminator="kind"),
]


class AnalysisPage(Page[AnyAnalysis]):
    """Analyses, the newest first."""
