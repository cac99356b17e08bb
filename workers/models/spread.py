"""What a result's deviations become where other models predict held-out pairs as well: the models' spread is added.

A fit's deviations hold if its model is right. To them this adds the other models' weighted second moment about the
fit: the between-model variance of Bayesian model averaging (Hoeting and others 1999).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from apexcal.geometry.rotations import vector_from_rotation
from apexcal.geometry.se3 import from_document

Json = dict[str, Any]
_TURNS: Final = ("rotation_x", "rotation_y", "rotation_z")
_OFFSETS: Final = ("t_x", "t_y", "t_z")
# What the parameters of all models mean alike.
_LENS: Final = ("f_x", "f_y", "c_x", "c_y")
# A difference of so many stated deviations is more than a result's own noise.
_SURPRISE: Final = 2.0


def spread_of(model: str, documents: Mapping[str, Json], weight: Mapping[str, float]) -> Json | None:
    """The deviations of ``model`` with the spread of the models added, by parameter; None where there is no other.

    ``documents``: results of fits to all pairs, by model. ``weight``: of the judged models. Models that the pairs do
    not determine take no part.
    """
    own = documents[model]
    weights = {
        name: share
        for name, share in weight.items()
        if name in documents and (name == model or documents[name]["status"] != "not_determined")
    }
    if model not in weights or len(weights) < 2 or not own.get("std"):
        return None
    whole = sum(weights.values())
    if whole <= 0.0:  # a model that the pairs do not determine has it all
        return None
    differences = {name: difference(documents[name], own) for name in weights if name != model}
    added = {
        name: sum(weights[other] / whole * one[name] ** 2 for other, one in differences.items() if name in one)
        for name in own["std"]
    }
    std = {
        name: None if value is None else float(np.hypot(value, added[name] ** 0.5))
        for name, value in own["std"].items()
    }
    widened = {name: std[name] / value for name, value in own["std"].items() if value and std[name]}
    half = own.get("interval95_half_width") or {}
    return {
        "weights": {name: share / whole for name, share in weights.items()},
        "std": std,
        "interval95_half_width": {
            name: None if value is None else value * widened.get(name, 1.0) for name, value in half.items()
        },
    }


def difference(one: Json, other: Json) -> dict[str, float]:
    """By parameter, of two results' mounts and lenses: turns about the camera's axes in degrees, metres, pixels."""
    mount, other_mount = from_document(one["transform"]), from_document(other["transform"])
    found = dict(zip(_TURNS, np.degrees(vector_from_rotation(mount.R @ other_mount.R.T)).tolist(), strict=True))
    found |= dict(zip(_OFFSETS, (mount.t - other_mount.t).tolist(), strict=True))
    lens, other_lens = one["intrinsics"], other["intrinsics"]
    return found | {name: lens[name] - other_lens[name] for name in _LENS if name in lens and name in other_lens}


def spread_sentence(model: str, documents: Mapping[str, Json], spread: Json | None) -> str | None:
    """A sentence, if a model that is not ruled out gives a mount that differs by more than is stated."""
    if spread is None:
        return None
    own, std = documents[model], documents[model]["std"]
    told: list[str] = []
    for name, share in sorted(spread["weights"].items(), key=lambda one: -one[1]):
        if name == model or share < 0.01:
            continue
        apart = difference(documents[name], own)
        sigmas = max((abs(apart[key]) / std[key] for key in (*_TURNS, *_OFFSETS) if std.get(key)), default=0.0)
        if sigmas > _SURPRISE:
            degrees = np.linalg.norm([apart[key] for key in _TURNS])
            millimetres = 1000 * np.linalg.norm([apart[key] for key in _OFFSETS])
            told.append(
                f"{name} (weight {share:.2f}) puts the mount {degrees:.2f} degrees and {millimetres:.0f} mm from "
                f"where {model} does, {sigmas:.1f} deviations that {model} states"
            )
    if not told:
        return None
    return f"{'; '.join(told)}: the pairs do not rule that out, so the published deviations include it."
