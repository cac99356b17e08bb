"""Words in the names of topics, frames and cameras."""

from __future__ import annotations

import re
from typing import Final

FILLERS: Final = frozenset({"cam", "camera", "image", "images", "raw", "color", "compressed", "data", "sensor"})


def words(text: str) -> frozenset[str]:
    """Return the lower-case words of a name; ``FrontLeft`` and ``front_left`` are two words each."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", text)
    return frozenset(part.lower().lstrip("0") or "0" for part in parts)


def telling(text: str) -> frozenset[str]:
    """Return the words of a name that tell one camera from another; all of them where none does."""
    return (words(text) - FILLERS) or words(text)
