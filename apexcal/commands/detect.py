"""The board's vertices in a recording: ``suggest`` a region, ``detect``."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from apexcal.client import FailedError
from apexcal.commands.named import find_recording
from apexcal.commands.options import ForceOption, RecordingArgument
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import check_target, note, usage, write_content
from apexcal.documents.analyses import SuggestionFacts
from apexcal.documents.detections import DetectionView, RollFacts
from apexcal.documents.detectors import DetectorName
from apexcal.json_files import parse_document
from apexcal.regions import parse_region, read_region

_KEEP = "Inequality that a point must meet, for example 'range < 9' or 'z / x > 0.2'; may be given several times."
# Below this share of accepted sweeps the region is more likely wrong than the board far away.
_FEW = 0.05
# Edges of a board that a person carries, metres. The detector takes 0 for "not known"; leaving --board out says that.
_EDGES_M = (0.1, 3.0)
_WALKED = (
    " But somebody walks in the recording. If it is a walk, upload it without --still. Then apexcal uses the track "
    "and the times of the points."
)
BoardCorner = Literal["tip", "upper-left", "upper-right"]
_UPPER_CORNERS: dict[BoardCorner, dict[str, Any]] = {
    "tip": {},
    "upper-left": {"upper_corner": 1},
    "upper-right": {"upper_corner": -1},
}
_EXAMPLES: dict[DetectorName, str] = {
    "refined": "max_sigma_deg=0.1",
    "tolerant": "min_points=10",
    "strict": "min_ring_span=3",
}


def suggest(
    session: Session,
    recording: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o")] = Path("region.json"),
    force: ForceOption = False,
) -> Reply:
    """Suggest a region: where somebody walked, or where the board of still poses stands. The LiDAR must not move.

    `apexcal detect RECORDING --region region.json --preview` shows what the region keeps. You may edit the file.

    Args:
        out: File to write the region into.
    """
    check_target(out, force)
    request = session.client.analyses.suggest(find_recording(session.client, recording).id)
    view = session.wait(request, "Looking for what moves")
    assert view.result is not None
    write_content(out, json.dumps(view.result.region, indent=2) + "\n")
    after = f"apexcal detect {view.recording_id} --region {out}"
    return Reply(view, f"{_suggestion(view.result.facts)}\nThe region is in {out}.", next=after)


def detect(
    session: Session,
    recording: RecordingArgument,
    keep: Annotated[list[str] | None, typer.Option(metavar="INEQUALITY")] = None,
    region: Path | None = None,
    detector: DetectorName = "refined",
    board: str = "",
    corner: BoardCorner = "tip",
    option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE")] = None,
    offset_ms: float = 0.0,
    max_gap_ms: Annotated[float, typer.Option(min=0)] = 50.0,
    interpolate: Annotated[bool | None, typer.Option("--interpolate/--nearest", show_default=False)] = None,
    preview: Annotated[bool, typer.Option("--preview")] = False,
) -> Reply:
    """Find a corner of the board in every sweep, inside a region of interest.

    Args:
        keep: Inequality that a point must meet, for example 'range < 9' or 'z / x > 0.2'; may be given
            several times.
        region: JSON file of a region, for trees with `or`.
        detector: How the corner is found; docs/detecting.md compares the detectors.
        board: Size of the board in metres, as 0.61x0.91 (refined).
        corner: Which corner: the top one of a board with a corner up (tip), or, of a board with level edges, an upper
            corner as the LiDAR sees it (refined, with --board).
        option: An option of the detector; several times.
        offset_ms: Camera clock minus LiDAR clock: added to a corner's time before its frame is looked for.
        max_gap_ms: Largest gap between a corner and its frame.
        interpolate: Move corners along their track to their frames' times. Default: those that have a track.
        preview: Only say what the region keeps.
    """
    if not keep and region is None:
        usage(
            "no region of interest",
            "Give --keep 'range < 9' (several times for several), or --region FILE; `apexcal suggest` writes one",
        )
    if keep and region is not None:
        usage("not both: --keep and --region are each a whole region", "Write the inequalities into the file")
    if not (math.isfinite(offset_ms) and math.isfinite(max_gap_ms)):
        usage(
            "--offset-ms and --max-gap-ms are finite numbers",
            "Both are in milliseconds, for example --offset-ms 12.5",
        )
    options = board_options(board, corner, detector) | _options(option or [], detector)
    tree = read_region(region) if region else parse_region(keep or [])
    detections, of = session.client.detections, find_recording(session.client, recording)
    if of.state == "failed":
        raise FailedError(f"the recording {of.name!r}", "failed", of.problem)
    if preview:
        view = session.wait(session.client.analyses.preview(of.id, tree), "Counting")
        counts = view.result
        assert counts is not None
        points = f"{counts.points_kept} of {counts.points} points"
        return Reply(view, f"The region keeps {points}, in {counts.frames_kept} of {counts.frames} sweeps.")
    for sensor in () if offset_ms else session.client.recordings.get(of.id).sensors:
        if sensor.facts.offset_ns:
            offset = f"--offset-ms {sensor.facts.offset_ns / 1e6:.3f}"
            note(f"The clock of {sensor.name} is apart from the LiDAR's: to pair its frames say {offset}.")
    request = detections.create(
        of.id,
        tree,
        detector=detector,
        options=options,
        offset_ns=round(offset_ms * 1e6),
        max_gap_ns=round(max_gap_ms * 1e6),
        mode="auto" if interpolate is None else "interpolate" if interpolate else "nearest",
    )
    detection = session.wait(request, "Detecting")
    after = f"apexcal open recording {of.id}, mark; then apexcal calibrate --detection {detection.id}"
    return Reply(detection, _outcome(detection), next=after)


def _suggestion(facts: SuggestionFacts) -> str:
    notes = "".join(f"\n  {note}" for note in facts.notes)
    if facts.poses:
        return (
            f"{facts.poses} still {'pose' if facts.poses == 1 else 'poses'}: the board, or somebody with it, stands "
            f"elsewhere in {facts.sweeps_moving} of {facts.sweeps_read} sweeps, within {facts.area_m2:.0f} square "
            f"metres. The detector leaves out what stands still there.{notes}"
        )
    return (
        f"Somebody walks in {facts.sweeps_moving} of {facts.sweeps_read} sweeps that were looked at, over "
        f"{facts.area_m2:.0f} square metres.{notes}"
    )


def board_options(text: str, corner: BoardCorner, detector: DetectorName = "refined") -> dict[str, Any]:
    """Return the detector's options for a board of ``WIDTHxHEIGHT`` metres and for the corner that is looked for."""
    if not text:
        if corner != "tip":
            usage(f"--corner {corner} needs the board's size", "Give its two edges in metres, as --board 0.61x0.91")
        return {}
    if detector != "refined":
        usage(f"--board is for refined only; {detector} does not use the board's size", "Leave --board out")
    try:
        width, height = (float(edge) for edge in re.split(r"[x×*]", text.lower()))
    except ValueError:
        usage(f"--board {text!r} is no size of a board", "Write its two edges in metres, as 0.61x0.91")
    least, most = _EDGES_M
    if not (least <= width <= most and least <= height <= most):
        usage(
            f"--board {text!r} is no size of a board: its edges are in metres, each from {least} to {most:g}",
            "Write it as 0.61x0.91; leave it out where the size is not known",
        )
    return {"board_width_m": width, "board_height_m": height} | _UPPER_CORNERS[corner]


def _options(texts: list[str], detector: DetectorName) -> dict[str, Any]:
    """``name=value`` pairs, the values as JSON."""
    options: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        try:
            options[name.strip()] = parse_document(value, f"the option {text!r}")
        except ValueError:
            equals = ""
        if not equals:
            example = f"--option {_EXAMPLES[detector]}"
            usage(f"--option {text!r} is no option", f"Write it as name=number, for example {example}")
    return options


def _outcome(detection: DetectionView) -> str:
    counts = detection.counts
    rejected = sorted(counts.rejected.items(), key=lambda item: -item[1])
    reasons = "".join(f"\n  {count} without: {_why(reason, detection.reasons)}" for reason, count in rejected)
    quality = ", ".join(f"{count} {name}" for name, count in sorted(counts.quality.items()))
    return (
        f"The detection {detection.id} accepted {counts.accepted} of {counts.sweeps} sweeps"
        f"{f' ({quality})' if quality else ''}, {counts.paired} of them with a camera frame."
        f"{_corner(detection)}{_poses(detection)}{reasons}{_roll(counts.roll)}{_size(detection)}{_advice(detection)}"
    )


def _corner(detection: DetectionView) -> str:
    """Say which corner people are to mark, if it is not the tip."""
    upper = detection.options.get("upper_corner")
    return f"\nThe corner is the board's upper {'left' if upper > 0 else 'right'} corner." if upper else ""


def _why(reason: str, sentences: Mapping[str, str]) -> str:
    name = reason.replace("_", " ")
    return f"{name}: {sentences[reason]}" if reason in sentences else name


def _poses(detection: DetectionView) -> str:
    """Say what was done differently for still poses; empty for a walk."""
    counts = detection.counts
    if not counts.poses:
        return ""
    these_are = "As you said, these are" if counts.poses_stated else "These seem to be"
    return (
        f"\n{these_are} {counts.poses} still poses. Each gives at most one corner. What stands still is left out. No "
        f"track is used.{_WALKED if counts.poses_walked else ''}"
    )


def _size(detection: DetectionView) -> str:
    """The board's size as its sweeps show it, beside the stated one; empty where they do not tell."""
    shown = detection.counts.size
    if shown is None:
        return ""
    looks = f"\nThe board looks like {_edges(shown.seen_m)} m (+- {max(shown.sigma_m):.3f})"
    if not _states_size(detection):
        return f"{looks}. No size was stated: measure the edges and state them with --board to get the other corners."
    stated = _edges(sorted(float(detection.options[f"board_{edge}_m"]) for edge in ("width", "height")))
    if not shown.contradicts:
        return f"{looks}; the stated {stated} m agree with that and were used."
    if not shown.replaces:
        return (
            f"{looks}; you said {stated} m, and that was used. Measure the board's edges, and detect again if they "
            "differ."
        )
    return (
        f"{looks}; you said {stated} m. The detection used the size that the board shows. To get the other corners, "
        "measure its edges and detect again."
    )


def _states_size(detection: DetectionView) -> bool:
    """Whether both edges of the board were stated."""
    return all(float(detection.options.get(f"board_{edge}_m", 0.0)) > 0.0 for edge in ("width", "height"))


def _edges(lengths: Sequence[float]) -> str:
    return " x ".join(f"{length:.3f}" for length in lengths)


def _roll(roll: RollFacts | None) -> str:
    """Say how the board was rolled; empty if the detector does not tell."""
    if roll is None:
        return ""
    way = "counter-clockwise" if roll.mean_deg > 0.0 else "clockwise"
    return (
        f"\nThe board was rolled by {abs(roll.mean_deg):.0f} degrees {way} as the LiDAR sees it "
        f"(+- {roll.spread_deg:.0f} from corner to corner; at 0 both upper edges have the same slope)."
    )


def _advice(detection: DetectionView) -> str:
    """Say what to do if hardly any sweep was accepted; empty otherwise."""
    counts = detection.counts
    if counts.accepted >= _FEW * (counts.poses or counts.sweeps):
        return ""
    if detection.detector == "strict":
        return "\nHint: strict accepts few sweeps by its nature; --detector tolerant or refined accepts more."
    if detection.detector == "refined" and not _states_size(detection):
        return (
            "\nHint: hardly any sweep was accepted, and the board's size was not stated. Measure its edges and state "
            "them with --board: more sweeps count then (docs/detecting.md)."
        )
    return "\nHint: hardly any sweep was accepted. The reasons above say what was seen instead (docs/detecting.md)."
