"""The check of a result against the limits of its rig's and fleet's publication policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sqlalchemy.orm import Session

from apexcal.documents.camera_models import EXTRINSICS
from apexcal.documents.checks import MARKS_CONFIRMED, Check, CheckTopic, figure
from apexcal.documents.publications import PublicationPolicy
from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Result

_POLICY = CheckTopic("policy", "Publication policy")
# Cells of the image, as `PublicationPolicy` defines coverage.
_COLUMNS, _ROWS = 8, 6
# As results name their deviations, in degrees and metres.
_TURNS = tuple(name for names in EXTRINSICS.values() for name in names[:3])
_SHIFTS = EXTRINSICS["rotation_vector"][3:]


class _Limit(NamedTuple):
    """A policy's limit of one measure, in words; ``sign`` is 1 for an upper limit, -1 for a lower."""

    what: str
    unit: str
    sign: int = 1


_LIMITS = {
    "heldout_mean_px": _Limit("the mean error of held-out pairs", "px"),
    "std_deg": _Limit("the largest standard deviation of a turn", "degrees"),
    "std_mm": _Limit("the largest standard deviation of the translation", "mm"),
    "halves_ratio": _Limit("the difference of halves of the pairs over what is stated", ""),
    "coverage": _Limit("the share of the image's cells that hold a pair", "", -1),
}


def policy_check(
    session: Session, result: Result, policy: PublicationPolicy, checks: Sequence[Check]
) -> Check | None:
    """Return the check of a fit to all pairs against the policy of its rig and fleet; None if that states nothing.

    checks: all others of the result, of which the policy may require some.
    """
    limits = policy.model_dump(exclude_none=True, include=set(_LIMITS))
    required = policy.required_checks or []
    if not limits and not required:
        return None
    measured = _measures(session, result, with_cells="coverage" in limits)
    missed = [
        _sentence(name, limit, measured[name]) for name, limit in limits.items() if _misses(name, limit, measured)
    ]
    missed += [
        f"The policy requires a check that was not made: {check.title}. {check.sentence}"
        for check in checks
        if check.name in required and check.verdict == "not_checked"
    ]
    return _POLICY.fails(
        "stop" if missed else "pass",
        " ".join(missed) or "It keeps the limits of the publication policy.",
        "Add pairs or data until it keeps the policy, or have an admin change that.",
        **{name: measured[name] for name in limits},
    )


def unattended_check(result: Result, policy: PublicationPolicy) -> Check | None:
    """Return the check of the machine's marks if it passes by the policy alone, else None."""
    stored = next((check for check in result.stored_checks if check.name == MARKS_CONFIRMED.name), None)
    if stored is None or stored.verdict == "pass" or not policy.publish_unattended:
        return None
    return MARKS_CONFIRMED.passes(f"{stored.sentence} The publication policy allows that.", **stored.figures)


def _misses(name: str, limit: float, measured: Mapping[str, float | None]) -> bool:
    value, sign = measured[name], _LIMITS[name].sign
    return value is None or sign * value > sign * limit


def _sentence(name: str, limit: float, value: float | None) -> str:
    rule = _LIMITS[name]
    unit = f" {rule.unit}" if rule.unit else ""
    bound = "at most" if rule.sign == 1 else "at least"
    is_now = f"it is {figure(value, 3)}{unit}" if value is not None else "this result does not have it"
    return f"The policy asks for {bound} {limit:g}{unit} as {rule.what}; {is_now}."


def _measures(session: Session, result: Result, *, with_cells: bool) -> dict[str, float | None]:
    std = result.published.std
    metres = _largest(std, _SHIFTS)
    return {
        "heldout_mean_px": result.summary and result.summary.heldout_mean_px,
        "halves_ratio": max((half.ratio for half in result.published.halves), default=None),
        "std_deg": _largest(std, _TURNS),
        "std_mm": None if metres is None else 1000.0 * metres,
        "coverage": _share_of_cells(session, result) if with_cells else None,
    }


def _largest(std: Mapping[str, float | None], names: Sequence[str]) -> float | None:
    """The largest of these deviations; None if there is none, or one of them is not determined."""
    deviations = [std[name] for name in names if name in std]
    determined = [deviation for deviation in deviations if deviation is not None]
    return max(determined) if determined and len(determined) == len(deviations) else None


def _share_of_cells(session: Session, result: Result) -> float | None:
    """The share of the image's cells that hold at least one pair that the fit did not leave out."""
    run = session.get_one(CalibrationRun, result.run_id)
    pairs = session.get_one(CorrespondenceSet, run.set_id).columns
    width, height = result.fit.intrinsics.image_size
    left_out = {outlier.index for outlier in result.fit.outliers if outlier.excluded}
    cells = {
        (int(_COLUMNS * u / width), int(_ROWS * v / height))
        for index, (u, v) in enumerate(zip(pairs["u"], pairs["v"], strict=True))
        if index not in left_out and 0 <= u < width and 0 <= v < height
    }
    return len(cells) / (_COLUMNS * _ROWS)
