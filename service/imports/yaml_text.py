"""Untrusted YAML: only plain values, without anchors, in bounded time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import yaml

from service.imports.contents import refused
from service.imports.members import AS_CAMERA_INFO, nested

_MATRIX = "tag:yaml.org,2002:opencv-matrix"
# Libyaml's composer calls itself for each level without a limit: some ten thousand end the process. No format that is
# read here has more than four.
_DEEPEST = 32
# Numbers to base 60 (1:1:1...) take the square of their length to read. No number that is read is longer.
_LONGEST_PLAIN = 1000
_RAISED = (yaml.YAMLError, RecursionError, ValueError, TypeError, LookupError, AttributeError, OverflowError)
# Libyaml's is ten times faster.
_Safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Safe):
    """Knows OpenCV's matrices as mappings, and no other tag that makes anything."""


def _matrix(loader: Any, node: Any) -> Any:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(_MATRIX, _matrix)
# As scripts write them that dump Python's own values.
_Loader.add_constructor(
    "tag:yaml.org,2002:python/tuple", lambda loader, node: loader.construct_sequence(node, deep=True)
)

# OpenCV takes ``data:[1, 2]``, YAML only ``data: [1, 2]``.
_CLOSE = re.compile(r"^([ \t]*[A-Za-z_][\w.]*):(?=[^\s:/])", re.MULTILINE)


def plain_text(text: str) -> str:
    """A text without byte order mark, directives (``%YAML:1.0``) and tabs, which other programs write."""
    lines = text.removeprefix("\ufeff").expandtabs(4).splitlines()
    begun = next((at for at, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "%#"), len(lines))
    directed = any(line.startswith("%") for line in lines[:begun])
    rest = "\n".join(line for at, line in enumerate(lines) if at >= begun or not line.startswith("%"))
    return _CLOSE.sub(r"\1: ", rest) if directed else rest


def read_yaml(name: str, text: str) -> Mapping[str, Any]:
    """The first document of a file, which is a mapping. JSON is YAML too.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    text = plain_text(text)
    if text.lstrip().startswith("<"):
        raise refused(f"{name} is XML.", f"Save it as YAML. {AS_CAMERA_INFO}")
    try:
        _check_bounded(name, text)
        document = next(iter(yaml.load_all(text, Loader=_Loader)), None)
    # Reading a value that its tag does not fit (`!!bool x`) raises what its way leads to.
    except _RAISED as error:
        reason = str(getattr(error, "problem", None) or type(error).__name__)[:100]
        what = f"{name} is no YAML: {reason}.{_first_line(text)}"
        raise refused(what, f"Send the file as the other program wrote it. {AS_CAMERA_INFO}") from None
    if isinstance(document, list) and all(isinstance(each, dict) for each in document):
        document = {str(index): each for index, each in enumerate(document)}
    if not isinstance(document, dict) or not document or not all(isinstance(key, str) for key in document):
        raise refused(f"{name} holds no named values.{_first_line(text)}", AS_CAMERA_INFO)
    return nested(_with_text_keys(document))


def _with_text_keys(value: Any) -> Any:
    """Return a value whose keys are text at every depth. YAML reads the key `1:` as a number and `on:` as a truth."""
    if isinstance(value, dict):
        members: dict[Any, Any] = value
        return {str(key): _with_text_keys(each) for key, each in members.items()}
    if isinstance(value, list):
        items: list[Any] = value
        return [_with_text_keys(each) for each in items]
    return value


def _first_line(text: str) -> str:
    line = next((line.strip() for line in text.splitlines() if line.strip()), "")
    return f" It begins with {line[:60]!r}." if line else ""


def _check_bounded(name: str, text: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        # A few lines of aliases to aliases would be merged into millions of members.
        if isinstance(event, yaml.AliasEvent):
            raise refused(f"{name} has YAML aliases (*name).", "Write the values out.")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent) and len(event.value) > _LONGEST_PLAIN and not event.implicit[1]:
            raise refused(f"{name} has a value of {len(event.value)} letters.", "Put text in quotes.")
        if depth > _DEEPEST:
            raise refused(f"{name} is nested more than {_DEEPEST} deep.", "Send the file as it was written.")
