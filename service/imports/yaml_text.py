"""Untrusted YAML: only plain values, without anchors, in bounded time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from service.imports.found import refused

_MATRIX = "tag:yaml.org,2002:opencv-matrix"
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
        # A few lines of aliases to aliases would be merged into millions of members.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=_Loader)):
            raise refused(f"{name} has YAML aliases (*name).", "Write the values out.")
        document = next(iter(yaml.load_all(text, Loader=_Loader)), None)
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as error:
        reason = str(getattr(error, "problem", None) or type(error).__name__)[:100]
        raise refused(f"{name} is no YAML: {reason}.", "Send the file as the other program wrote it.") from None
    if not isinstance(document, dict) or not all(isinstance(key, str) for key in document):
        raise refused(f"{name} holds no named values.", "Send the file as the other program wrote it.")
    return document
