"""Find the format that a request asks for, and answer in it.

The formats are imported when one is asked for: they need NumPy, which takes a twentieth of the start.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Query, Request
from fastapi.responses import Response

from service.platform.http.etags import Conditions, content_etag, repr_digest

if TYPE_CHECKING:
    from service.exports.calibrated import Calibrated

_TYPE = "application/vnd.apexcal."


async def _wanted(
    request: Request,
    format: Annotated[
        str | None, Query(max_length=40, description="A format of `/v1/export-formats`; by default JSON.")
    ] = None,
) -> str | None:
    if format is not None:
        return None if format == "json" else format
    return format_of_accept(request)


WantedFormat = Annotated[str | None, Depends(_wanted)]


def format_of_accept(request: Request) -> str | None:
    """The first of our formats that `Accept` names; None, which is JSON, if it names none."""
    for accepted in request.headers.get("accept", "").split(","):
        named = accepted.partition(";")[0].strip().lower()
        if named.startswith(_TYPE):
            return named.removeprefix(_TYPE).partition("+")[0]
    return None


def exported(format_name: str, calibrated: Calibrated, conditions: Conditions) -> Response:
    """The answer with its ETag.

    Raises what 304 is answered by, and :class:`Problem` 422 ``unknown_format``, 406 ``format_cannot_carry``.
    """
    from service.exports.formats import export, find_format

    file = export(find_format(format_name), calibrated)
    etag = content_etag(sha256(file.content).hexdigest())
    conditions.offer(etag)
    headers = {
        **notes_header(file.notes),
        "ETag": etag,
        "Vary": "Accept",
        "Content-Disposition": f'attachment; filename="{file.name}"',
        "Cache-Control": "private, no-cache",
        **repr_digest(file.content),
    }
    return Response(file.content, media_type=file.media_type, headers=headers)


def notes_header(notes: Sequence[str]) -> dict[str, str]:
    """Return the header of notes on a file: a JSON list of sentences, since headers are ASCII."""
    return {"Apexcal-Notes": json.dumps(notes)} if notes else {}


def table() -> list[dict[str, object]]:
    """Every format and what it carries."""
    from service.exports.formats import FORMATS

    return [
        {
            "name": format.name,
            "title": format.title,
            "media_type": f"{_TYPE}{format.name}",
            "direction": format.direction,
            "lenses": sorted(format.lenses) if format.carries_lens else [],
            "skew": format.skew and format.carries_lens,
            "third_radial": format.third_radial and format.carries_lens,
            "needs_T_vehicle_lidar": format.needs_vehicle,
            "one_lidar": format.one_lidar,
        }
        for format in FORMATS.values()
    ]
