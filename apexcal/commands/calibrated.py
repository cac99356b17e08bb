"""Prints a finished calibration: a table per camera, warnings, and whether the result was published."""

from __future__ import annotations

from rich import box
from rich.table import Table

from apexcal.commands.common import console
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.results import Errors
from apexcal.documents.summaries import CameraSummary, RigSummary, Summary

# If the held-out error is more than this many times the fitted one, the model fits noise or has too few pairs.
_OVERFITTED = 2.0


def show(calibration: CalibrationView) -> None:
    """Print the notes on the pairs, then for each camera a table and its sentences, then the rig's."""
    out = console()
    summary = calibration.summary or Summary(cameras={})
    for note in calibration.notes:
        out.print(f"Note: {note}", markup=False, soft_wrap=True)
    for name, camera in summary.cameras.items():
        out.print(table_of(name, camera))
        if camera.why:
            out.print(f"* {camera.why}", markup=False, soft_wrap=True)
        out.print(lens_of(camera), markup=False, soft_wrap=True)
        for warning in warnings_of(camera):
            out.print(f"Warning: {warning}", markup=False, soft_wrap=True)
        for objection in objections_of(camera):
            out.print(f"Against publishing it: {objection}", markup=False, soft_wrap=True)
    rig = summary.rig or RigSummary()
    for pair in rig.pairs:
        for sentence in pair.sentences:
            out.print(sentence, markup=False, soft_wrap=True)
    for alarm in rig.alarms:
        out.print(f"Warning: {alarm}", markup=False, soft_wrap=True)


def table_of(name: str, camera: CameraSummary) -> Table:
    """The models side by side. Fits into 80 columns, the width if a terminal states none."""
    table = Table(
        title=f"Camera {name}: mean / RMS reprojection error, pixels",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for heading in ("model", "GA", "polished", "baseline", "held out"):
        table.add_column(heading, justify="left" if heading == "model" else "right", no_wrap=True)
    for model, found in camera.models.items():
        table.add_row(
            model + (" *" if model == camera.recommended else ""),
            *(_pair(found.stages.get(stage)) for stage in ("ga", "polished", "baseline")),
            _pixels(found.heldout_mean_px),
        )
    return table


def warnings_of(camera: CameraSummary) -> list[str]:
    """Models that do much worse on pairs that they were not fitted to, and the recommended model's alarms."""
    warnings: list[str] = []
    for model, found in camera.models.items():
        heldout, fitted = found.heldout_mean_px, found.polished.mean_px if found.polished else 0.0
        if heldout is not None and heldout > _OVERFITTED * fitted:
            warnings.append(
                f"{model} is at {heldout:.2f} px on held-out pairs, at {fitted:.2f} px on fitted ones: there are too "
                "few pairs for it, or they are too close together."
            )
    recommended = camera.models.get(camera.recommended or "")
    return warnings + [f"{camera.recommended}: {alarm}" for alarm in (recommended.alarms if recommended else [])]


def objections_of(camera: CameraSummary) -> list[str]:
    """Objections to publishing the recommended result; none if ``not_published`` states them already."""
    recommended = camera.models.get(camera.recommended or "")
    # A calibration by an older version has no objections field.
    return [] if camera.not_published or recommended is None else recommended.objections or []


def lens_of(camera: CameraSummary) -> str:
    """Where the recommended model's lens comes from, and how well a stated one fits."""
    found = camera.models.get(camera.recommended or "")
    return f"Lens of {camera.recommended}: {found.lens}. {found.stated_lens or ''}".strip() if found else ""


def why_unpublished(camera: CameraSummary, *, wanted: bool) -> str:
    """Why no result of this camera became the vehicle's current calibration, and what to do about it."""
    by_hand = "A reviewer can publish a result with `apexcal publish`, or on the calibration's page."
    if not wanted:
        return f"--publish was not given. {by_hand}"
    reasons = camera.not_published
    if reasons:
        return " ".join([*reasons, by_hand])
    return f"another result has been published since. {by_hand}"


def _pair(figures: Errors | None) -> str:
    """``mean / rms`` of one stage."""
    return f"{_pixels(figures.mean_px)} / {_pixels(figures.rms_px)}" if figures else "-"


def _pixels(value: float | None) -> str:
    """A figure with two decimals."""
    return "-" if value is None else f"{value:.2f}"
