"""Values of parameters as requests and rigs give them, brought under the solver's names and units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import radians
from typing import Any

from apexcal.documents.bounds import Interval
from apexcal.documents.camera_models import ModelName, SearchForm, all_names, bare_name
from service.http.problems import Problem


def in_radians(given: Mapping[str, Any]) -> dict[str, Any]:
    """The same values under the solver's names: what is given in degrees becomes radians."""
    return {bare_name(name): _radians(value) if bare_name(name) != name else value for name, value in given.items()}


def check_names(
    given: Mapping[str, Any], where: str, models: Iterable[ModelName], search: SearchForm
) -> dict[str, Any]:
    """The values by parameter name, angles in radians; every name must be a parameter of one of the models.

    Raises:
        Problem: 422 ``unknown_parameter``.
    """
    names = all_names(models, search)
    for name in given:
        if bare_name(name) not in names:
            raise Problem(
                422,
                "unknown_parameter",
                f"{where} names {name!r}, which is no parameter of {' or '.join(models)} in the form {search}.",
                f"The parameters are {', '.join(names)}; angles are in radians, or in degrees with _deg behind.",
                parameters=list(names),
            )
    values = in_radians(given)
    if len(values) < len(given):
        raise Problem(
            422, "unknown_parameter", f"{where} names an angle twice, in radians and in degrees.", "Give it once."
        )
    return values


def check_order(bounds: Mapping[str, Interval]) -> None:
    """Refuse bounds whose lower end is not below the upper end: 422 ``bounds_inside_out``."""
    for name, (low, high) in bounds.items():
        if not low < high:
            raise Problem(
                422,
                "bounds_inside_out",
                f"The bounds of {name} are inside out: the lower end {low:g} is not below the upper end {high:g}.",
                "Give them as [lower, upper]; a parameter that is known goes into `locked`.",
            )


def _radians(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: radians(number) for name, number in value.items()}
    if isinstance(value, list | tuple):
        return [radians(number) for number in value]
    return radians(value)
