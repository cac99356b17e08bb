"""Correspondence sets without their pairs, as the answers show them."""

from __future__ import annotations

from apexcal.documents.correspondence_sets import SetView
from service.platform.db.calibrations import CorrespondenceSet


def set_view(row: CorrespondenceSet) -> SetView:
    """A set without its pairs."""
    return SetView.model_validate(row, from_attributes=True)
