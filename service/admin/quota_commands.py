"""``apexcal admin quota``: shows and sets how many bytes a fleet's recordings may take."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any

import typer
from sqlalchemy import select

from service.admin.context import AdminError, JsonOption, WrongUsageError, command, opened, spoken, table
from service.platform.db.fleets import Fleet
from service.platform.storage.quota import spoken as said
from service.platform.storage.quota import uses

quota = typer.Typer(no_args_is_help=True, help="Show and set how much the recordings of a fleet may take.")

_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?(?:([kMGT])(i?)B|B)?")
_POWERS = {"": 0, "k": 1, "M": 2, "G": 3, "T": 4}
# What a column of the database holds.
_LARGEST = 2**63 - 1


@quota.command("show")
@spoken
def show(as_json: JsonOption = False) -> None:
    """Show for each fleet what its recordings take and may take."""
    with opened() as service, service.database.reading() as session:
        fleets = session.scalars(select(Fleet).order_by(Fleet.name)).all()
        taken = uses(session, fleets, service.settings.fleet_quota_bytes)
        rows: list[dict[str, Any]] = [
            {
                "fleet": fleet.name,
                "taken_bytes": taken[fleet.id].taken,
                "quota_bytes": taken[fleet.id].allowed,
                "own": fleet.quota_bytes is not None,
            }
            for fleet in fleets
        ]
    if as_json:
        print(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    lines = [
        {
            "fleet": row["fleet"],
            "taken": said(row["taken_bytes"]),
            "quota": said(row["quota_bytes"]),
            "set": "for it" if row["own"] else "default",
        }
        for row in rows
    ]
    print(table(lines, ("fleet", "taken", "quota", "set")))


@quota.command("set")
@spoken
def set_quota(
    fleet: Annotated[str, typer.Argument(help="Name of the fleet, as `quota show` has it.")],
    size: Annotated[str, typer.Argument(help="For example 500GB, or 'default' for APEXCAL_FLEET_QUOTA_BYTES.")],
) -> None:
    """Set how much the recordings of a fleet may take. Nothing is deleted where they take more already."""
    quota = None if size == "default" else _bytes(size)
    with opened() as service, service.database.writing() as session:
        row = session.scalars(select(Fleet).where(Fleet.name == fleet).with_for_update()).one_or_none()
        if row is None:
            raise AdminError(f"there is no fleet called {fleet!r}", f"{command('quota show')} lists the fleets.")
        row.quota_bytes = quota
        row.version += 1
        use = uses(session, [row], service.settings.fleet_quota_bytes)[row.id]
    print(f"The recordings of {fleet} may take {said(use.allowed)}; they take {said(use.taken)}.")


def _bytes(text: str) -> int:
    """Raises :class:`WrongUsageError`."""
    match = _SIZE.fullmatch(text)
    base = 1024 if match and match[3] else 1000
    size = round(float(match[1]) * base ** _POWERS[match[2] or ""]) if match else _LARGEST + 1
    if size > _LARGEST:
        raise WrongUsageError(f"{text!r} is no size", "Write it as 500GB, 1.5TB, a number of bytes, or 'default'.")
    return size
