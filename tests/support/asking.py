"""What an engineer asks for over HTTP until workers have something to fit: pairs that are brought, a calibration."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from apexcal.client import Client
from apexcal.documents.machine_marks import MarksView
from tests.support.people import Actor


def bring_pairs(actor: Actor, rig_id: Any, pairs: list[dict[str, Any]], camera: str = "front") -> str:
    """Import pairs of a camera; the id of their set."""
    answer = actor.post(f"/rigs/{rig_id}/correspondence-sets", {"pairs": pairs}, params={"camera": camera})
    assert answer.status_code in (200, 201), answer.text
    return answer.json()["id"]


def ask_calibration(actor: Actor, vehicle_id: Any, *sets: str, **request: Any) -> str:
    """Ask for a calibration of these sets; its id."""
    body = {"correspondence_set_ids": list(sets), **request}
    answer = actor.post(f"/vehicles/{vehicle_id}/calibrations", body)
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def leave_marks_to_people(owner: Client, recording_id: UUID | str) -> None:
    """End the machine's marking of a recording: it takes longer than detection and a fit together."""
    for analysis in owner.analyses.list(MarksView, recording_id=recording_id):
        owner.analyses.delete(analysis.id)
