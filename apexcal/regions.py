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

_BEGINNINGS = {"and", "or", "not", "quantity", "box", "polygon", "level"}
_NAME = "|".join(QUANTITIES)
_INEQUALITY = re.compile(
    rf"\s*(?P<quantity>{_NAME})\s*(?:/\s*(?P<by>{_NAME}))?\s*(?P<op><=|>=|<|>)\s*(?P<value>[-+]?[0-9.]+(?:e[-+]?\d+)?)\s*",
    re.IGNORECASE,
)


def parse_region(inequalities: Sequence[str]) -> Document:
    """The region where all these inequalities hold, as the API takes it. Nothing of the text is evaluated.

    Raises :class:`InputError` that quotes the inequality that cannot be read.
    """
    nodes = [_leaf(text) for text in inequalities]
    return nodes[0] if len(nodes) == 1 else {"and": nodes}


def read_region(path: Path) -> Document:
    """A region from a JSON file, for trees with `or` in them. Raises :class:`InputError`."""
    document = read_document(path)
    if not isinstance(document, dict):
        raise InputError(f"{path} holds no region", 'A region looks like {"quantity": "x", "op": ">", "value": 0}.')
    if not _BEGINNINGS & set(document):
        raise InputError(
            f"{path} is no region",
            'A region begins with "and", "or", "not", "quantity", "box", "polygon" or "level"; `apexcal suggest` '
            "writes one.",
        )
    return document


def _leaf(text: str) -> Document:
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
    leaf: Document = {"quantity": match["quantity"].lower(), "op": match["op"], "value": value}
    if match["by"]:
        leaf["divided_by"] = match["by"].lower()
    return leaf
