"""Whether the parts of an upload make the file that its sender declares."""

from __future__ import annotations

from collections.abc import Sequence

from apexcal.documents.recordings import Completion
from apexcal.documents.states import RecordingState
from service.platform.db.recordings import Recording, UploadPart
from service.platform.http.problems import Problem


def check_complete(row: Recording, parts: Sequence[UploadPart], declared: Completion) -> bool:
    """True where ingestion may start, False where it did already after the same declaration.

    Raises :class:`Problem` 409 ``parts_missing``, ``size_differs``, ``upload_closed``.
    """
    numbers = {part.number for part in parts}
    missing = [number for number in range(1, declared.parts + 1) if number not in numbers]
    if missing:
        raise Problem(
            409,
            "parts_missing",
            f"{len(missing)} of {declared.parts} parts have not arrived, the first of them {missing[0]}.",
            "Send the parts listed in `missing`, then complete again.",
            missing=missing[:1000],
        )
    size = sum(part.size for part in parts)
    if len(numbers) != declared.parts or size != declared.size:
        raise Problem(
            409,
            "size_differs",
            f"{len(numbers)} parts of {size} bytes arrived; declared are {declared.parts} of {declared.size}.",
            "Compare with GET .../parts. Did the file change meanwhile? Then upload it as a new recording.",
        )
    if row.state == RecordingState.UPLOADING:
        return True
    if row.sha256 != declared.sha256:
        raise Problem(
            409,
            "upload_closed",
            f"This upload was completed with the SHA-256 {row.sha256}, not {declared.sha256}.",
            "Make a new recording to upload another file.",
        )
    return False
