"""Untrusted YAML: only plain values, without anchors, in bounded time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from service.imports.contents import refused

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


def read_yaml(name: str, text: str) -> Mapping[str, Any]:
    """The first document of a file, which is a mapping. JSON is YAML too.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    # OpenCV writes a directive that YAML does not know.
    head, _, rest = text.partition("\n")
    if head.startswith("%YAML:"):
        text = rest
    try:
        _check_bounded(name, text)
        document = next(iter(yaml.load_all(text, Loader=_Loader)), None)
    # Reading a value that its tag does not fit (`!!bool x`) raises what its way leads to.
    except _RAISED as error:
        reason = str(getattr(error, "problem", None) or type(error).__name__)[:100]
        raise refused(f"{name} is no YAML: {reason}.", "Send the file as the other program wrote it.") from None
    if not isinstance(document, dict) or not all(isinstance(key, str) for key in document):
        raise refused(f"{name} holds no named values.", "Send the file as the other program wrote it.")
    return document


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
