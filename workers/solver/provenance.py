"""The inputs and sources behind a result: enough to compute it again, and to explain different bits."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

_SOURCES: Final = (
    *("workers/geometry/**/*.py", "workers/solver/**/*.py"),
    *(f"apexcal/documents/{name}.py" for name in ("bounds", "camera_models", "fit_requests", "pairs", "schedules")),
)
_NUMBERS: Final = frozenset("xyzuv")


@cache
def sources_sha256() -> str:
    """SHA-256 over names and texts of every module of `workers.geometry` and `workers.solver`, and of the documents
    that they read; hexadecimal.

    A version number does not tell an edited checkout from the release; this does, in a wheel as well.
    """
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for path in sorted(path for pattern in _SOURCES for path in root.glob(pattern)):
        text = path.read_text(encoding="utf-8").encode()  # line ends of the platform become \n
        digest.update(f"{path.relative_to(root).as_posix()} {len(text)}\n".encode())
        digest.update(text)
    return digest.hexdigest()


def pairs_sha256(pairs: Mapping[str, Sequence[Any]]) -> str:
    """SHA-256 of a correspondence set's columns as compact JSON with sorted names, hexadecimal."""
    columns = {
        name: [float(value) for value in values] if name in _NUMBERS else list(values)
        for name, values in pairs.items()
    }
    text = json.dumps(columns, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
