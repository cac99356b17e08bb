"""Guesses which topic is which of the rig's cameras, by image size and by words in the names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from workers.readers.recording import Sensor
from workers.readers.topic_words import telling, words

Sizes = Mapping[str, tuple[int, int]]


def guess_cameras(names: Sequence[str], topics: Sequence[Sensor], sizes: Sizes) -> dict[str, Sensor]:
    """The topics of those cameras for which one is clear.

    A topic may be a camera's where its first frame has the size that the rig says (topics whose size is not known
    stay in). Among these, the words of the camera's name are looked for in the topic's name, else in its frame_id:
    the camera with the most words chooses first, and of several topics that hold them all the one with the fewest
    other words is taken. What is left over is clear where it is one camera and one topic.

    Args:
        names: the cameras that have no topic yet.
        topics: the topics that belong to no camera yet, each of another name.
        sizes: (width, height) per camera where the rig says it.
    """
    found: dict[str, Sensor] = {}
    for source in (_topic_words, _frame_words):
        for count in sorted({len(telling(name)) for name in names}, reverse=True):
            free = _not_in(topics, found)
            said = {topic.name: source(topic) for topic in free}
            matches = {
                name: _match(telling(name), [(t, said[t.name]) for t in _of_size(free, sizes.get(name))])
                for name in names
                if name not in found and len(telling(name)) == count
            }
            picked = Counter(topic.name for topic in matches.values() if topic)
            found |= {name: topic for name, topic in matches.items() if topic and picked[topic.name] == 1}
    _leftovers(names, topics, sizes, found)
    return found


def _not_in(topics: Sequence[Sensor], found: Mapping[str, Sensor]) -> list[Sensor]:
    taken = {topic.name for topic in found.values()}
    return [topic for topic in topics if topic.name not in taken]


def _topic_words(topic: Sensor) -> frozenset[str]:
    return words(topic.name)


def _frame_words(topic: Sensor) -> frozenset[str]:
    return words(topic.frame_id)


def _match(wanted: frozenset[str], topics: Sequence[tuple[Sensor, frozenset[str]]]) -> Sensor | None:
    holding = sorted(((len(said - wanted), i) for i, (_, said) in enumerate(topics) if wanted <= said))
    if not holding or (len(holding) > 1 and holding[0][0] == holding[1][0]):
        return None
    return topics[holding[0][1]][0]


def _of_size(topics: Sequence[Sensor], size: tuple[int, int] | None) -> Sequence[Sensor]:
    """Topics that may have frames of that size; all where none has, so that the size is what gets reported."""
    if size is None:
        return topics
    return [t for t in topics if _size(t) in (None, size)] or topics


def _size(topic: Sensor) -> tuple[int, int] | None:
    width, height = topic.notes.get("width", ""), topic.notes.get("height", "")
    return (int(width), int(height)) if width.isdigit() and height.isdigit() else None


def _leftovers(names: Sequence[str], topics: Sequence[Sensor], sizes: Sizes, found: dict[str, Sensor]) -> None:
    """One camera and one topic left, or one topic of a size that one camera alone has."""
    while True:
        left = [name for name in names if name not in found]
        free = _not_in(topics, found)
        if len(left) == 1 and len(free) == 1:
            found[left[0]] = free[0]
            return
        clear = {name: [t for t in free if _size(t) == sizes.get(name)] for name in left if sizes.get(name)}
        for name, fitting in clear.items():
            twins = [other for other in left if other != name and sizes.get(other, sizes[name]) == sizes[name]]
            if len(fitting) == 1 and not twins:
                found[name] = fitting[0]
                break
        else:
            return
