"""What an engineer asks for over HTTP until workers have something to fit: pairs that are brought, a calibration."""

from __future__ import annotations

from typing import Any

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
