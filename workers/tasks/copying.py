"""A recording with its published calibration, as another file of the store: its own file, or one for viewers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.recordings import Recording
from service.platform.jobs.claims import Claim, Lease
from workers.readers.limited import write_limited
from workers.tasks.analysis_files import keeping, store_file
from workers.tasks.context import Context
from workers.tasks.originals import join_parts, watching
from workers.tasks.viewing import viewer_file

_EDITS = ("lidar_frame", "cameras", "poses")


def calibrated_copy(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Write the file in a limited child, and store it."""
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        recording = session.get_one(Recording, analysis.recording_id)
    question = analysis.asked
    write_file, ending = (viewer_file, "for-viewers") if question.get("for_viewers") else (_copy, "calibrated")
    with context.scratch() as folder:
        facts = write_file(context, recording, question, folder, lease)
        file = folder / "copy" / facts["file"]
        key = store_file(context, claim, file, f"recordings/{recording.id}/copies")
        name = f"{_stem(recording.file_name)}-{ending}{file.suffix}"
        counts = {count: facts[count] for count in ("copied", "replaced", "added", "left_out") if count in facts}
        return keeping(claim, key, file, name, counts)


def _copy(context: Context, recording: Recording, question: Json, folder: Path, lease: Lease) -> dict[str, Any]:
    """The recording's own file with the calibration put in."""
    source = join_parts(context, recording, folder, lease)
    request = {"copy": {name: question[name] for name in _EDITS}}
    return write_limited(
        [source], folder / "copy", request, **watching(context, recording, lease, "copying messages")
    )


def _stem(file_name: str) -> str:
    """The recording's name without its ends (.tar.gz), at most 200 letters of it."""
    return (file_name.lstrip(".").partition(".")[0] or "recording")[:200]
