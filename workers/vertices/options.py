"""The numbers that steer a detector: announced as a JSON schema, checked before anything is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workers.geometry.errors import InputError

Options = Mapping[str, float]


class DetectorError(InputError):
    """A detector or an option that is not known or out of its limits.

    Codes: ``detector_unknown``, ``detector_option_unknown``, ``detector_option_invalid``.
    """


def number_options(**options: tuple[str, float, float, float, str]) -> dict[str, Any]:
    """JSON schema of number options: name -> (type, default, minimum, maximum, description)."""
    names = ("type", "default", "minimum", "maximum", "description")
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {key: dict(zip(names, value, strict=True)) for key, value in options.items()},
    }


def overlay(detector: str, schema: Mapping[str, Any], options: Mapping[str, Any] | None) -> Options:
    """Defaults of ``schema`` overlaid with ``options``, checked against it.

    Args:
        detector: its name, for messages.

    Raises:
        DetectorError: ``detector_option_unknown`` or ``detector_option_invalid``.
    """
    properties: Mapping[str, Mapping[str, Any]] = schema["properties"]
    resolved: dict[str, float] = {key: described["default"] for key, described in properties.items()}
    for key, value in (options or {}).items():
        if key not in properties:
            raise DetectorError(
                "detector_option_unknown",
                f"detector {detector!r} has no option {key!r}",
                f"Its options: {', '.join(properties)}.",
            )
        described = properties[key]
        kinds = int if described["type"] == "integer" else int | float
        is_number = isinstance(value, kinds) and not isinstance(value, bool)
        if not is_number or not described["minimum"] <= value <= described["maximum"]:
            raise DetectorError(
                "detector_option_invalid",
                f"option {key!r} of detector {detector!r} cannot be {value!r}",
                f"Give a {described['type']} between {described['minimum']} and {described['maximum']}.",
            )
        resolved[key] = value
    return resolved
