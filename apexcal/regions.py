"""Regions of interest as people type them: ``x > 0``, ``range < 9``, ``z / x > 0.2``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from apexcal.documents.regions import QUANTITIES
from apexcal.errors import InputError
from apexcal.json_files import read_document
from apexcal.transport import Document

_NAME = "|".join(QUANTITIES)
_INEQUALITY = re.compile(
    rf"\s*(?P<quantity>{_NAME})\s*(?:/\s*(?P<by>{_NAME}))?\s*(?P<op><=|>=|<|>)\s*(?P<value>[-+]?[0-9.]+(?:e[-+]?\d+)?)\s*",
    re.IGNORECASE,
)


def parse_region(inequalities: Sequence[str]) -> Document:
    """The region where all these inequalities hold, as the API takes it. Nothing of the text is evaluated.

    Raises :class:`InputError` that quotes the inequality that cannot be read.
    """
    return {"all": [_inequality(text) for text in inequalities]}


def read_region(path: Path) -> Document:
    """A region from a JSON file. Raises :class:`InputError`."""
    document = read_document(path)
    if not isinstance(document, dict) or "all" not in document:
        raise InputError(
            f"{path} is no region",
            'A region looks like {"all": [{"quantity": "x", "op": ">", "value": 0}]}; `apexcal suggest` writes one.',
        )
    return document


def _inequality(text: str) -> Document:
    match = _INEQUALITY.fullmatch(text)
    try:
        value = float(match["value"]) if match else None
    except ValueError:
        value = None
    if match is None or value is None:
        raise InputError(
            f"{text!r} is no inequality", f"Write for example 'z / x > 0.2'; there is {', '.join(QUANTITIES)}."
        )
    if not math.isfinite(value):
        raise InputError(f"{text!r} compares with a number that is too large", "It must be a finite number.")
    part: Document = {"quantity": match["quantity"].lower(), "op": match["op"], "value": value}
    if match["by"]:
        part["divided_by"] = match["by"].lower()
    return part
