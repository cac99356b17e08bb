"""What an analysis is made from."""

from __future__ import annotations

from typing import NamedTuple
from uuid import UUID

from service.platform.db.base import Json


class Plan(NamedTuple):
    """Plain data for the worker, and the detection that the analysis is of, if it is of one."""

    asked: Json
    detection_id: UUID | None = None
