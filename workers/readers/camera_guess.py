"""Guesses which topic belongs to which camera of the rig, by image size and by words in the names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from apexcal.documents.name_words import telling, words
from workers.readers.recording import Sensor

Sizes = Mapping[str, tuple[int, int]]


def guess_cameras(names: Sequence[str], topics: Sequence[Sensor], sizes: Sizes) -> dict[str, Sensor]:
    """The topics of those cameras for which exactly one fits.

    1. A topic fits a camera if its first frame has the size that the rig states, or if its size is not known.
    2. All words of the camera's name must occur in the topic's name. Topics' frame_ids are searched after all names.
    3. Cameras whose names have the most words choose first. If several topics hold all words, a camera chooses the
       one with the fewest other words, or none if two have equally few. A topic that two choose goes to neither.
    4. A camera and a topic that are left over belong together if they are the only ones, or the only ones of a size.

    Args:
        names: the cameras that have no topic yet.
        topics: the topics that belong to no camera yet, each of another name.
        sizes: (width, height) per camera where the rig says it.
    """
    matched: dict[str, Sensor] = {}
    for source in ("name", "frame_id"):
        for count in sorted({len(telling(name)) for name in names}, reverse=True):
            free = _not_in(topics, matched)
            words_of = {topic.name: words(getattr(topic, source)) for topic in free}
            matches = {
                name: _match(telling(name), [(t, words_of[t.name]) for t in _of_size(free, sizes.get(name))])
                for name in names
                if name not in matched and len(telling(name)) == count
            }
            picked = Counter(topic.name for topic in matches.values() if topic)
            matched |= {name: topic for name, topic in matches.items() if topic and picked[topic.name] == 1}
    _leftovers(names, topics, sizes, matched)
    return matched


def _not_in(topics: Sequence[Sensor], matched: Mapping[str, Sensor]) -> list[Sensor]:
    taken = {topic.name for topic in matched.values()}
    return [topic for topic in topics if topic.name not in taken]


def _match(name_words: frozenset[str], topics: Sequence[tuple[Sensor, frozenset[str]]]) -> Sensor | None:
    holding = sorted(
        ((len(topic_words - name_words), i) for i, (_, topic_words) in enumerate(topics) if name_words <= topic_words)
    )
    if not holding or (len(holding) > 1 and holding[0][0] == holding[1][0]):
        return None
    return topics[holding[0][1]][0]


def _of_size(topics: Sequence[Sensor], size: tuple[int, int] | None) -> Sequence[Sensor]:
    """Topics that may have frames of that size. If none may, all: then the error names the size, not the topic."""
    if size is None:
        return topics
    return [t for t in topics if t.image_size in (None, size)] or topics


def _leftovers(names: Sequence[str], topics: Sequence[Sensor], sizes: Sizes, matched: dict[str, Sensor]) -> None:
    """Pair what is left: one camera and one topic, or the only camera and the only topic of a size."""
    while True:
        left = [name for name in names if name not in matched]
        free = _not_in(topics, matched)
        if len(left) == 1 and len(free) == 1:
            matched[left[0]] = free[0]
            return
        clear = {name: [t for t in free if t.image_size == sizes.get(name)] for name in left if sizes.get(name)}
        for name, fitting in clear.items():
            twins = [other for other in left if other != name and sizes.get(other, sizes[name]) == sizes[name]]
            if len(fitting) == 1 and not twins:
                matched[name] = fitting[0]
                break
        else:
            return
