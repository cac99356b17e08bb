"""Which kinds of jobs there are, on which queue each waits, and how many of a fleet's may be out at once."""

from __future__ import annotations

from typing import NamedTuple


class Queue(NamedTuple):
    """Kinds that share processes. ``fleet_cap`` names the setting that caps a fleet's jobs, sent or running."""

    kinds: tuple[str, ...]
    fleet_cap: str | None = None


_QUEUES = {
    # The maker of a file decides how long it takes to read: one fleet must not hold every process.
    "ingest": Queue(("ingest",), fleet_cap="fleet_ingests"),
    "detect": Queue(("preview", "suggestion", "detect")),
    "solve": Queue(("clock_offset", "solve")),
    # Not behind a fleet's waiting runs: it is a moment's work, and a calibration ends with it.
    "report": Queue(("consistency",)),
}
QUEUES = tuple(_QUEUES)
QUEUE_OF_KIND = {kind: name for name, queue in _QUEUES.items() for kind in queue.kinds}
FLEET_CAPS = {name: queue.fleet_cap for name, queue in _QUEUES.items() if queue.fleet_cap}
