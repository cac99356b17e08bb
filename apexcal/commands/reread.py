"""``apexcal reread``: reads a failed recording again from its original, with further options."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.client import ClientError
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say
from apexcal.commands.connect import connected, find_recording, find_rig
from apexcal.commands.reading import LidarModelOption, RingsOption, StillOption, TopicOption, reading_of
from apexcal.commands.upload import wait_until_read, what_it_is
from apexcal.embedded.folder import DEFAULT
from apexcal.transport import Document


def reread(
    recording: Annotated[str, typer.Argument(help="A failed recording, by id or by name.")],
    rig: Annotated[str, typer.Option(help="Another rig of the same vehicle, by name or id.")] = "",
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Read a failed recording again from its original. Options add to those given before."""
    known = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings)
    with connected(url, token, data) as client:
        of = find_recording(client, recording)
        if of.state != "failed":
            raise ClientError(f"the recording {of.name!r} is {of.state}", "Only a failed one is read again.")
        changes: dict[str, object] = {}
        if rig:
            changes["rig_id"] = str(find_rig(client, client.vehicles.get(of.vehicle_id), rig).id)
        if known:
            changes["reading"] = _added(of.reading.model_dump(mode="json", exclude_unset=True), known)
        if changes:
            of = client.recordings.edit(of, **changes)
        of = client.recordings.retry(of.id)
        with bar("Reading the recording", not as_json) as progress:
            of = wait_until_read(client, of, progress)
    say(of, as_json, what_it_is(of))


def _added(before: Document, known: Document) -> Document:
    """What was said before with what is said now; of the topics, each by its name."""
    topics, more = before.get("topics") or {}, known.get("topics") or {}
    cameras = (topics.get("cameras") or {}) | (more.get("cameras") or {})
    both = topics | more | ({"cameras": cameras} if cameras else {})
    return before | known | ({"topics": both} if both else {})
