"""A finished calibration as people see it: a table per camera, its checks, whether it was published."""

from __future__ import annotations

from rich import box
from rich.console import RenderableType
from rich.table import Table

from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.checks import Check, verdict_of
from apexcal.documents.results import Errors
from apexcal.documents.summaries import CameraSummary, Summary


def tables(calibration: CalibrationView) -> list[RenderableType]:
    """The notes on the pairs, then for each camera a table and its sentences, then the rig's."""
    summary = calibration.summary or Summary(cameras={}, rig=None)
    parts: list[RenderableType] = [f"Note: {note}" for note in calibration.notes]
    for name, camera in summary.cameras.items():
        parts.append(table_of(name, camera))
        parts += [f"* {camera.why}"] if camera.why else []
        parts += [lens_of(camera), verdict_line(camera)]
        parts += [f"  {line}" for line in doubts(camera)]
    if summary.rig:
        parts += [sentence for pair in summary.rig.pairs for sentence in pair.sentences]
        parts += [f"Warning: {alarm}" for alarm in summary.rig.alarms]
    return parts


def table_of(name: str, camera: CameraSummary) -> Table:
    """The models side by side. Fits into 80 columns, the width if a terminal states none."""
    table = Table(
        title=f"Camera {name}: mean / RMS reprojection error, pixels",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for heading in ("model", "GA", "polished", "baseline", "held out", "verdict"):
        table.add_column(heading, justify="left" if heading == "model" else "right", no_wrap=True)
    for model, figures in camera.models.items():
        table.add_row(
            model + (" *" if model == camera.recommended else ""),
            *(_pair(figures.stages.get(stage)) for stage in ("ga", "polished", "baseline")),
            _pixels(figures.heldout_mean_px),
            figures.verdict or "-",
        )
    return table


def verdict_line(camera: CameraSummary) -> str:
    """The verdict on the recommended model's result, with its own lens and alone."""
    model = camera.models.get(camera.recommended or "")
    if model is None:
        return "Verdict: none, because no model is recommended."
    alone = "" if model.verdict_alone == model.verdict else f"; {model.verdict_alone} for the mount with another lens"
    return f"Verdict on {camera.recommended}: {verdict_of(camera.checks, 'mount_with_lens')}{alone}."


def doubts(camera: CameraSummary) -> list[str]:
    """Return the doubts about the recommended result, a line each, and the checks that were not made."""
    open_titles = [check.title for check in camera.checks if check.verdict == "not_checked"]
    lines = [line_of(check) for check in camera.checks if check.is_doubt]
    return lines + ([f"Not checked: {', '.join(open_titles)}."] if open_titles else [])


def line_of(check: Check) -> str:
    """One check in a line: its verdict, what it found, and what to do."""
    alone = " (mount alone)" if check.scope == "mount_alone" else ""
    return f"{check.verdict}{alone}: {check.sentence} {check.remedy}".strip()


def lens_of(camera: CameraSummary) -> str:
    """Say where the recommended model's lens comes from, and how well a stated one fits."""
    model = camera.models.get(camera.recommended or "")
    return f"Lens of {camera.recommended}: {model.lens}. {model.stated_lens or ''}".strip() if model else ""


def why_unpublished(camera: CameraSummary, *, publish: bool) -> str:
    """Why no result of this camera became the vehicle's current calibration, and what to do about it."""
    by_hand = "A reviewer can publish a result with `apexcal publish`, or on the calibration's page."
    if not publish:
        return f"--publish was not given. {by_hand}"
    if not camera.published:
        return f"a check keeps it back. {by_hand}"
    return f"another result has been published since. {by_hand}"


def _pair(figures: Errors | None) -> str:
    """``mean/rms`` of one stage."""
    return f"{_pixels(figures.mean_px)}/{_pixels(figures.rms_px)}" if figures else "-"


def _pixels(value: float | None) -> str:
    """A figure with two decimals."""
    return "-" if value is None else f"{value:.2f}"
