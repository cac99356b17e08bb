"""The child that reads an upload: ``python -m workers.readers SOURCE OUT --request JSON``.

Prints JSON lines: ``{"progress": {"done", "total", "share", "seconds_left"}}``, ``{"beat": true}`` where work goes on
without messages, and at the end ``{"manifest": {...}, "used": {"cpu_s", "resident_bytes", "written_bytes"}}`` (of one
file, requested by ``copy`` or ``view``: ``{"file": {...}, "used": {...}}``; requested by ``inspect``, which writes
nothing: ``{"inspection": {...}, "used": {...}}``) or
``{"error": {"code", "message", "hint", "fields"}}``. With ``--parent`` and ``--limits`` it is what ``ingest_limited``
starts; without them it is a command for people.
"""

from __future__ import annotations

import argparse
import errno
import json
import os
import resource
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from apexcal.documents.base import first_fault
from apexcal.documents.errors import InputError
from apexcal.documents.readings import ReadOptions
from workers.readers.confine import add_child_options, confine
from workers.readers.isolation.isolate import isolate
from workers.readers.normalised.normalise import normalise
from workers.readers.output import OutputLimitError, ReserveError, bytes_written, limit_output
from workers.readers.progress import IngestProgress, Pace, tell_beats
from workers.readers.recording import ReadError

if TYPE_CHECKING:
    from apexcal.documents.inspections import Inspection

_OPTIONS: Final = f"Options are {', '.join(ReadOptions.model_fields)}; leave out what is not known."

# What a limit raises, and its code; the process that started this one has the sentence.
_LIMITS: Final[dict[type[BaseException], str]] = {
    MemoryError: "ingest_memory_limit",
    OutputLimitError: "ingest_output_limit",
    ReserveError: "ingest_disk_full",
}
_SYSTEM: Final = {
    errno.EFBIG: "ingest_file_limit",
    errno.ENOSPC: "ingest_disk_full",
    errno.ENOMEM: "ingest_memory_limit",
}


Room = Callable[[argparse.Namespace, dict[str, Any]], dict[str, Any]]


def _say(line: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def _error(code: str, message: str, hint: str, more: Mapping[str, Any] | None = None) -> int:
    _say({"error": {"code": code, "message": message, "hint": hint, "fields": dict(more or {})}})
    return 1


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m workers.readers", description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--request", type=json.loads, default={}, help="JSON: lidar, cameras, image_sizes, options")
    parser.add_argument("--also", type=Path, action="append", default=[], help="another file that the request names")
    add_child_options(parser)
    return parser.parse_args(argv)


def _take_limits(arguments: argparse.Namespace) -> None:
    """Take on the limits of this process, before it opens anything."""
    limits: dict[str, int] = arguments.limits
    confine(arguments.parent, limits)
    limit_output(limits.get("output_bytes"), limits.get("video_output_bytes"), limits.get("reserve_bytes", 0))
    if arguments.parent is not None:
        tell_beats(lambda: _say({"beat": True}))
        isolate([arguments.source, *arguments.also], [arguments.out, Path(tempfile.gettempdir())])


def main(argv: Sequence[str] | None = None, *, room: Room | None = None) -> int:
    """Run one ingestion, write one file, or do what ``room`` does; the exit code is 0 only with its outcome."""
    arguments = _arguments(argv)
    _take_limits(arguments)
    request: dict[str, Any] = arguments.request
    try:
        answer = (room or _room(request))(arguments, request)
    except (ReadError, InputError) as error:
        return _error(error.code, error.message, error.hint, error.fields)
    except (MemoryError, OutputLimitError, ReserveError, OSError) as error:
        code = _LIMITS.get(type(error)) or _SYSTEM.get(getattr(error, "errno", None) or 0)
        if code is None:
            raise
        return _error(code, "", "")
    _say(answer | {"used": _used()})
    return 0


def _room(request: dict[str, Any]) -> Room:
    """Return the function that does the requested work."""
    if request.get("inspect"):
        return _inspected
    return _written if "copy" in request or "view" in request else _normalised


def options_of(request: dict[str, Any]) -> ReadOptions:
    """The options of a request. Raises ReadError ``request_invalid``."""
    try:
        return ReadOptions.model_validate(request.get("options", {}))
    except ValidationError as error:
        where, wrong = first_fault(error)
        what = f"The options of the ingestion are wrong: {where}: {wrong}."
        raise ReadError("request_invalid", what, _OPTIONS) from None


def _inspected(arguments: argparse.Namespace, request: dict[str, Any]) -> dict[str, Any]:
    return {"inspection": inspected(arguments.source, request).model_dump(mode="json")}


def inspected(source: Path, request: dict[str, Any]) -> Inspection:
    """Inspect a recording; ``urdf``, or the transforms of the recording ``tf_from``, states its mounts."""
    from apexcal.documents.rig_proposals import RigAnswers
    from workers.readers.inspection import inspect_recording, static_transforms_of

    urdf, tf_from = request.get("urdf"), request.get("tf_from")
    return inspect_recording(
        source,
        request.get("lidar"),
        request.get("cameras"),
        options_of(request),
        RigAnswers.model_validate(request.get("rig", {})),
        Path(urdf).read_bytes() if urdf else None,
        static_transforms_of(Path(tf_from)) if tf_from else None,
    )


def _normalised(arguments: argparse.Namespace, request: dict[str, Any]) -> dict[str, Any]:
    manifest = normalise(
        arguments.source,
        arguments.out,
        lidar=request.get("lidar"),
        cameras=request.get("cameras"),
        sizes={name: (width, height) for name, (width, height) in request.get("image_sizes", {}).items()},
        options=options_of(request),
        on_progress=on_progress,
    )
    return {"manifest": manifest.model_dump(mode="json")}


def _written(arguments: argparse.Namespace, request: dict[str, Any]) -> dict[str, Any]:
    pace = Pace(None)

    def tell(share: float) -> None:
        if pace.due:
            on_progress(IngestProgress(0, None, share, None))

    # Loaded before the recording is opened, and only by who needs it.
    if "copy" in request:
        from workers.readers.copying.copy_recording import copy_recording

        return {"file": copy_recording(arguments.source, arguments.out, request["copy"], tell)}
    from workers.readers.viewing.viewer_file import write_viewer_file

    return {"file": write_viewer_file(arguments.source, arguments.out, request["view"], tell)}


def on_progress(progress: IngestProgress) -> None:
    """Print the progress as a line."""
    _say({"progress": asdict(progress)})


def _used() -> dict[str, float]:
    """Processor seconds, the highest resident memory (``ru_maxrss`` may be its parent's), and bytes written."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:  # seen under Landlock where memory was short: Linux makes the folder anew, and no rule knows it
        lines = []
    peak = next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), usage.ru_maxrss)
    return {"cpu_s": usage.ru_utime + usage.ru_stime, "resident_bytes": peak * 1024, "written_bytes": bytes_written()}


if __name__ == "__main__":
    # What libraries written in C print goes where errors go, and not between the lines for the parent.
    sys.stdout = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.exit(main())
