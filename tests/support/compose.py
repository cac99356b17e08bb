"""Reads docker-compose.yml as compose does, as far as our file goes: anchors, merges, interpolation."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from tests.support.places import ROOT

FILE = ROOT / "docker-compose.yml"

# $$, ${NAME}, ${NAME:-default}, ${NAME:?what to do}
_VARIABLE = re.compile(r"\$\$|\$\{(?P<name>\w+)(?::(?P<how>[-?])(?P<rest>[^}]*))?\}")


class MissingVariableError(Exception):
    """A variable that the file demands is not set."""


def load(variables: Mapping[str, str]) -> dict[str, Any]:
    """The file with the values of its variables in place."""
    document: dict[str, Any] = _filled(yaml.safe_load(FILE.read_text()), variables)
    return document


def demanded() -> set[str]:
    """The variables without which nothing starts."""
    return {match["name"] for match in _VARIABLE.finditer(FILE.read_text()) if match["how"] == "?"}


def image_environment() -> dict[str, str]:
    """What the Dockerfile's last stage puts into the environment."""
    text = (ROOT / "Dockerfile").read_text().rpartition("\nFROM ")[2].replace("\\\n", " ")
    settings = [line.removeprefix("ENV ") for line in text.splitlines() if line.startswith("ENV ")]
    return dict(word.split("=", 1) for line in settings for word in shlex.split(line))


@dataclass(frozen=True)
class Part:
    """A service of ours as a plain process: its command and environment, with ``substitutes`` put in."""

    command: list[str]
    environment: dict[str, str]
    health: list[str]


def part(document: dict[str, Any], name: str, substitutes: Mapping[str, str]) -> Part:
    """The service of this name, every text of it with the ``substitutes`` in place, longest first."""

    def put_in(text: str) -> str:
        for old in sorted(substitutes, key=len, reverse=True):
            text = text.replace(old, substitutes[old])
        return text

    service = document["services"][name]
    environment = image_environment() | {key: str(value) for key, value in service["environment"].items()}
    return Part(
        [put_in(word) for word in service["command"]],
        {key: put_in(value) for key, value in environment.items()},
        [put_in(word) for word in service.get("healthcheck", {}).get("test", [])],
    )


def _filled(value: Any, variables: Mapping[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(each, variables) for key, each in value.items()}
    if isinstance(value, list):
        return [_filled(each, variables) for each in value]
    return _VARIABLE.sub(lambda match: _value(match, variables), value) if isinstance(value, str) else value


def _value(match: re.Match[str], variables: Mapping[str, str]) -> str:
    if match[0] == "$$":
        return "$"
    given = variables.get(match["name"], "")
    if not given and match["how"] == "?":
        raise MissingVariableError(match["name"])
    return given or (match["rest"] or "")
