"""JSON that people write: read so that what cannot be sent is refused where it stands."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from apexcal.errors import InputError

# Far more than anything that the service takes (regions: 16), far less than what Python can encode again.
_DEEPEST = 100


def read_document(path: Path) -> Any:
    """A JSON file's content. Raises :class:`InputError` that names the file where it cannot be read or sent."""
    try:
        return parse_document(path.read_text(encoding="utf-8"), str(path))
    except OSError as error:
        raise InputError(f"cannot read {path}: {(error.strerror or '').lower()}") from None
    except ValueError as error:
        raise InputError(f"{path} is no JSON: {error}") from None


def parse_document(text: str, name: str) -> Any:
    """The content of a JSON text, its numbers finite.

    Raises ValueError where it is no JSON, :class:`InputError` that begins with ``name`` where it cannot be sent.
    """

    def finite(number: str) -> float:
        value = float(number)
        return value if math.isfinite(value) else refuse(number)

    def refuse(number: str) -> NoReturn:
        raise InputError(f"{name} holds {number}", "Every number in it must be a finite number.")

    try:
        document = json.loads(text, parse_float=finite, parse_constant=refuse)
        too_deep = _is_deeper(document, _DEEPEST)
    except RecursionError:
        document, too_deep = None, True
    if too_deep:
        raise InputError(f"{name} is nested too deeply", f"Nothing here needs more than {_DEEPEST} levels.")
    return document


def _is_deeper(document: Any, limit: int) -> bool:
    level = [document]
    for _ in range(limit + 1):
        level = [
            child
            for node in level
            if isinstance(node, (dict, list))
            for child in (node.values() if isinstance(node, dict) else node)
        ]
    return bool(level)
