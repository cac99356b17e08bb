"""How formats write numbers."""

from __future__ import annotations

import numpy as np

from apexcal.geometry.se3 import Floats


def numbers(values: Floats | list[float]) -> list[float]:
    """Numbers by rows, as Python's own: they are written so that reading gives the same bits. No negative zeros."""
    return [float(value) + 0.0 for value in np.ravel(values)]


def yaml_number(value: float) -> str:
    """YAML 1.1 takes ``1e-05`` for text: a number has a point."""
    text = repr(float(value) + 0.0)
    return text if "." in text else text.replace("e", ".0e")


def yaml_list(values: Floats | list[float]) -> str:
    """Numbers by rows, in brackets."""
    return f"[{', '.join(map(yaml_number, numbers(values)))}]"
