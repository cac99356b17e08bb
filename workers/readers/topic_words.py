"""The meaning of topics' names: words, derived products, and twins of one sensor."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from apexcal.documents.name_words import FILLERS, words
from workers.readers.recording import Sensor

# Words of topics that hold something computed from a sensor's data instead of the data.
_DERIVED: Final = frozenset(
    (
        *("annotated", "clusters", "cropped", "debug", "depth", "deskewed", "detections", "disparity", "downsampled"),
        *("filtered", "ground", "map", "mask", "masks", "nonground", "objects", "obstacle", "obstacles", "overlay"),
        *("preview", "registered", "segmentation", "segmented", "theora", "thumbnail", "visualization"),
    )
)
_TRANSPORTS: Final = ("/compressed", "/ffmpeg")
# Words of topics that say how their images were made.
_FORMS: Final = frozenset(("mono", "rect", "rectified", "undistorted"))
# Of one camera's topics the one without corrections comes first: the lens is to be fitted, not its correction.
_IMAGE_ORDER: Final = ("image_raw", "image", "image_color", "image_mono", "image_rect_color", "image_rect")


def short_name(topic: str) -> str:
    """A camera's name after its topic: ``front`` for ``/camera/front/image_raw``, its slug where nothing is left."""
    parts = [part for part in slug(topic).split("_") if part not in FILLERS | _FORMS]
    return "_".join(parts) if any(map(str.isalpha, "".join(parts))) else slug(topic)


def bare_topic(topic: str) -> str:
    """An image topic without the name that image_transport puts behind it for the form of its messages."""
    return next((topic.removesuffix(form) for form in _TRANSPORTS if topic.endswith(form)), topic)


def slug(topic: str) -> str:
    """A topic or path as a name of lower-case words joined by ``_``, at most 64 characters."""
    parts = [part for part in re.split(r"[^A-Za-z0-9]+", bare_topic(topic)) if part]
    return "_".join(parts).lower()[:64] or "camera"


def primary(topics: Sequence[Sensor]) -> list[Sensor]:
    """The topics less what is derived from others: depth, overlays, rectified twins, raw forms of compressed ones.

    Where nothing but such topics is there, they stay.
    """
    names = {topic.name for topic in topics}
    left = [topic for topic in topics if names.isdisjoint(topic.name + form for form in _TRANSPORTS)]
    left = [topic for topic in left if _DERIVED.isdisjoint(words(topic.name))] or left
    most = max((topic.count or 0 for topic in left), default=0)
    left = [topic for topic in left if topic.count is None or topic.count * 20 >= most]
    by_parent: dict[str, list[Sensor]] = {}
    for topic in left:
        by_parent.setdefault(_split(topic)[0], []).append(topic)
    return [topic for topic in left if topic is _best(by_parent[_split(topic)[0]], topic)]


def _split(topic: Sensor) -> tuple[str, str]:
    """Namespace and last word of an image topic; a topic that is no such is its own namespace."""
    parent, _, last = bare_topic(topic.name).rpartition("/")
    return (parent, last) if last in _IMAGE_ORDER else (topic.name, "")


def _best(twins: Sequence[Sensor], otherwise: Sensor) -> Sensor:
    ranked = sorted((_IMAGE_ORDER.index(last), i) for i, t in enumerate(twins) if (last := _split(t)[1]))
    return twins[ranked[0][1]] if ranked else otherwise
