"""The report as one HTML file that needs nothing else: the built page with a document inside."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

from workers.readers.recording import ReadError
from workers.reports.material import FrameImage

Json = dict[str, Any]
# All pictures together: the file must stay below 3 MB.
_PICTURES_BYTES: Final = 1_000_000
_DATA_PLACE: Final = "REPORT_DATA"


def page(document: Json, frames: Mapping[int, FrameImage] | None = None) -> str:
    """Return the file. ``document``: see ``contents``; ``frames``: images by number of the pair, shown of outliers.

    The document is JSON, gzipped, in base64: no name in it can leave its place. Raises :class:`ReadError`
    ``pages_not_built``.
    """
    text = json.dumps(document | {"pictures": _pictures(document, frames or {})}, ensure_ascii=False, allow_nan=False)
    packed = base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()
    return _template().replace(_DATA_PLACE, packed, 1)


def _template() -> str:
    built = files("workers.reports").joinpath("report.html")
    if not built.is_file():
        raise ReadError(
            "pages_not_built",
            "This worker has no page to write the report's numbers into.",
            "Run `make frontend` in the worker's checkout, or install a wheel. Then ask for the report again.",
        )
    return built.read_text(encoding="utf-8")


def _pictures(document: Json, frames: Mapping[int, FrameImage]) -> Json:
    """Frames of the outliers as the browser shows them, the worst first, as long as the file has room."""
    pictures: Json = {}
    left = _PICTURES_BYTES
    for outlier in document["result"]["outliers"]:
        frame = frames.get(outlier["index"])
        if frame is None or len(frame.data) * 4 // 3 > left:
            continue
        left -= len(frame.data) * 4 // 3
        address = f"data:{frame.media_type};base64,{base64.b64encode(frame.data).decode()}"
        pictures[str(outlier["index"])] = {"address": address, "width": frame.width, "height": frame.height}
    return pictures
