"""Data that a worker hands over when it ends a job, for the kind's ``take`` to go on with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple
from uuid import UUID

from apexcal.documents.summaries import Summary
from service.platform.db.base import Json
from service.platform.db.calibrations import Slot


class SlotBundle(NamedTuple):
    """Slots of a run's iteration, which are written.

    ``narrow`` gets the state of the run's search and all slots of the iteration. It returns the state after it, and
    whether the search stops.
    """

    narrow: Callable[[Json | None, Sequence[Slot]], tuple[Json, bool]]


class Conclusion(NamedTuple):
    """A calibration's summary, and the columns of its judged results with their ids.

    ``current``: by camera, the vehicle's current result that these were judged beside. ``reopened``: how often the
    calibration had been reopened then. ``problem``: of a failed run.
    """

    summary: Summary
    judged: Sequence[Json]
    current: Mapping[str, UUID | None]
    reopened: int
    problem: Json | None


class RunEnd(NamedTuple):
    """The end of a run. ``run`` has its ``id``, ``fleet_id`` and ``calibration_id``; ``result``: columns of its row.

    ``search``: its state and the number of iterations, if they are not on record yet.
    ``conclusion``: of the calibration, where this seemed to be the last of its runs.
    """

    run: Any
    result: Json
    search: tuple[Json, int] | None
    conclusion: Conclusion | None
