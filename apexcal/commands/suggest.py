"""``apexcal suggest``: a region of interest, computed from what moves against the still background."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import (
    DataOption,
    JsonOption,
    TokenOption,
    UrlOption,
    bar,
    check_target,
    say,
    write_target,
)
from apexcal.commands.connect import connected, find_recording
from apexcal.documents.studies import SuggestionFacts
from apexcal.embedded.folder import DEFAULT


def suggest(
    recording: Annotated[str, typer.Argument(help="Recording, by id or by name.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write the region into.")] = Path("region.json"),
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Suggest a region: where somebody walked, or where the board of still poses stands. The LiDAR must not move.

    `apexcal detect RECORDING --region region.json --preview` shows what the region keeps. You may edit the file.
    """
    check_target(out, force)
    with connected(url, token, data) as client, bar("Looking for what moves", not as_json) as progress:
        of = find_recording(client, recording)
        done = client.wait(client.detections.suggest(of.id), on_progress=progress)
    assert done.result is not None
    write_target(out, json.dumps(done.result.region, indent=2) + "\n")
    say(done, as_json, f"{_what_was_found(done.result.facts)}\nThe region is in {out}.")


def _what_was_found(facts: SuggestionFacts) -> str:
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
