"""Counts with their intervals."""

from __future__ import annotations

from scipy import special


def interval(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share, `count` of `of` draws (Clopper and Pearson 1934)."""
    low = float(special.betaincinv(count, of - count + 1, 0.025)) if count else 0.0
    return low, float(special.betaincinv(count + 1, of - count, 0.975)) if count < of else 1.0


def share(count: int, of: int) -> str:
    """The share with its interval."""
    if not of:
        return "none of 0"
    low, high = interval(count, of)
    return f"{count / of:.3f} ({low:.3f}-{high:.3f})"
