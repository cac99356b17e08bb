"""The report as one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from workers.reports.drawing import draw
from workers.reports.material import FrameImage
from workers.reports.plots import rows_of, sections_of

Json = dict[str, Any]
# All pictures together: the file must stay below 3 MB, and its plots take up to 1.5 MB of that.
_PICTURES_BYTES: Final = 1_000_000
# Half the width and height of the part of the frame that is shown, pixels of the frame.
_AROUND_PX: Final = (120, 80)


def page(document: Json, frames: Mapping[int, FrameImage] | None = None) -> str:
    """The file. ``document``: see ``contents``; ``frames``: images by number of the pair, shown of outliers."""
    sections = sections_of(document)
    drawn = {plot.name: Markup(draw(plot, document)) for section in sections for plot in section.plots}
    rows = {plot.name: rows_of(plot, document) for section in sections for plot in section.plots}
    embedded = json.dumps(document | {"plots": rows}, ensure_ascii=False, separators=(",", ":"))
    return _template().render(
        report=document,
        sections=sections,
        drawn=drawn,
        pictures=_pictures(document, frames or {}),
        # An end tag in a name would end the script.
        data=Markup(embedded.replace("<", "\\u003c")),
        style=Markup(_text("page.css")),
        script=Markup(_text("page.js")),
    )


def _pictures(document: Json, frames: Mapping[int, FrameImage]) -> dict[int, Json]:
    """Frames of the outliers as the browser shows them, the worst first, as long as the file has room."""
    pictures: dict[int, Json] = {}
    left = _PICTURES_BYTES
    for outlier in document["result"]["outliers"] or []:
        number = outlier["index"]
        frame = frames.get(number)
        if frame is None or len(frame.data) * 4 // 3 > left:
            continue
        left -= len(frame.data) * 4 // 3
        pairs = document["pairs"]
        u, v = pairs["u"][number], pairs["v"][number]
        across, down = _AROUND_PX
        pictures[number] = {
            "address": f"data:{frame.media_type};base64,{base64.b64encode(frame.data).decode()}",
            "width": frame.width,
            "height": frame.height,
            "box": f"{u - across:.0f} {v - down:.0f} {2 * across} {2 * down}",
            "mark": (u, v),
            "projected": (pairs["projected_u"][number], pairs["projected_v"][number]),
        }
    return pictures


@cache
def _template() -> Any:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["digits"] = _digits
    return environment.from_string(_text("page.html"))


def _text(name: str) -> str:
    return files("workers.reports").joinpath(name).read_text(encoding="utf-8")


def _digits(value: float | None, places: int = 2) -> str:
    return "–" if value is None else f"{value:.{places}f}"
