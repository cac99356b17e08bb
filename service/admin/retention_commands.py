"""``apexcal admin retention``: shows and sets when recordings are deleted, and deletes what is due."""

from __future__ import annotations

import json
from datetime import timedelta
from math import inf
from typing import Annotated, Any

import typer
from sqlalchemy import func, select

from service.admin.context import AdminError, JsonOption, WrongUsageError, as_id, command, opened, spoken, table
from service.platform.auth.retention import remove_ended
from service.platform.db.clock import utc_now
from service.platform.db.fleets import Fleet
from service.platform.db.recordings import LAYERS, Recording
from service.platform.jobs.retention import forget_jobs, overdue_jobs
from service.recordings.retention import delete_old_imports, delete_overdue, expire_uploads, remove_old_layers

retention = typer.Typer(
    no_args_is_help=True, help="Show and set when recordings are deleted, and delete what is due."
)


@retention.command("show")
@spoken
def show(as_json: JsonOption = False) -> None:
    """Show how many recordings of each fleet have an end or are overdue, and how many ended jobs are overdue."""
    moment = utc_now()
    with opened() as service, service.database.reading() as session:
        rows: list[dict[str, Any]] = [
            {"fleet": name, "recordings": count, "bytes": int(size), "with_end": ending, "overdue": overdue}
            for name, count, size, ending, overdue in session.execute(
                select(
                    Fleet.name,
                    func.count(Recording.id),
                    func.coalesce(func.sum(Recording.size), 0),
                    func.count(Recording.retain_until),
                    func.count(Recording.id).filter(Recording.retain_until < moment),
                )
                .outerjoin(Recording, Recording.fleet_id == Fleet.id)
                .group_by(Fleet.name)
                .order_by(Fleet.name)
            )
        ]
        jobs = {"kept_days": service.settings.job_days, "overdue": overdue_jobs(session)}
    if as_json:
        print(json.dumps({"fleets": rows, "jobs": jobs}, indent=2))
        return
    print(table(rows, ("fleet", "recordings", "bytes", "with_end", "overdue")))
    print(f"\nEnded jobs are kept {jobs['kept_days']} days (APEXCAL_JOB_DAYS); {jobs['overdue']} are overdue.")


@retention.command("set")
@spoken
def set_end(
    recording: Annotated[str, typer.Argument(help="A recording's id; with --fleet, a fleet's name.")],
    days: Annotated[int, typer.Option(help="Days from now; 0 for no end.", min=0, max=36_500)],
    fleet: Annotated[bool, typer.Option("--fleet", help="All recordings of the fleet of this name.")] = False,
) -> None:
    """Set when a recording, or all of a fleet, is deleted. A vehicle's current calibration keeps its recording."""
    end = utc_now() + timedelta(days=days) if days else None
    if fleet:
        which = Recording.fleet_id.in_(select(Fleet.id).where(Fleet.name == recording))
    else:
        which = Recording.id == as_id(
            recording, "recording", "For all recordings of a fleet, give its name and --fleet."
        )
    with opened() as service, service.database.writing() as session:
        recordings = session.scalars(select(Recording).where(which).with_for_update()).all()
        if not recordings:
            what = f"no recording in a fleet called {recording!r}" if fleet else f"no recording {recording}"
            raise AdminError(f"there is {what}", f"{command('retention show')} lists the fleets.")
        for row in recordings:
            row.retain_until = end
            row.version += 1
        count = len(recordings)
    print(f"{count} recordings {f'are deleted after {end:%Y-%m-%d %H:%M} UTC' if end else 'are kept'}.")


@retention.command("layers")
@spoken
def set_layers(
    fleet: Annotated[str, typer.Argument(help="Name of the fleet.")],
    original: Annotated[int, typer.Option(help="Days for the file as it came; 0 for no end.", min=0)] = 0,
    images: Annotated[int, typer.Option(help="Days for the cameras' images, and copies.", min=0)] = 0,
    sweeps: Annotated[int, typer.Option(help="Days for the LiDAR's sweeps.", min=0)] = 0,
    pairs: Annotated[int, typer.Option(help="Days for imported pairs of which nothing was published.", min=0)] = 0,
) -> None:
    """Set after how many days layers of a fleet's recordings go. Pairs, results and publications of them stay."""
    days = {"original": original, "images": images, "sweeps": sweeps, "pairs": pairs}
    ends = [days[layer] or inf for layer in LAYERS]
    if ends != sorted(ends):
        raise WrongUsageError(
            "layers go in one order", "Give the original the fewest days, then images, then sweeps."
        )
    with opened() as service, service.database.writing() as session:
        row = session.scalars(select(Fleet).where(Fleet.name == fleet).with_for_update()).one_or_none()
        if row is None:
            raise AdminError(f"there is no fleet called {fleet!r}", f"{command('retention show')} lists the fleets.")
        row.retention = {layer: count for layer, count in days.items() if count} or None
    ends_in_words = ", ".join(f"{layer} after {count} days" for layer, count in days.items() if count)
    print(f"Of {fleet} go: {ends_in_words or 'no layers'}.")


@retention.command("run")
@spoken
def run() -> None:
    """Delete now what is overdue, as the service does every ten minutes. The reaper removes the bytes later."""
    with opened() as service:
        recordings = delete_overdue(service.database)
        layers = remove_old_layers(service.database)
        pairs = delete_old_imports(service.database)
        uploads = expire_uploads(service.database)
        jobs = forget_jobs(service.database)
        remove_ended(service.database)
    print(f"{recordings} recordings, {pairs} sets of imported pairs and {jobs} jobs deleted, ", end="")
    print(f"{uploads} unfinished uploads ended, layers of {layers} recordings removed.")
