"""What hosts with wrong clocks write and decide: nothing else than hosts with right ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from sqlalchemy import select, update

from service.platform.db.clock import now
from service.platform.db.models import Blob, CorrespondenceSet, Fleet, Recording
from service.platform.db.session import Database
from tests.service.calibrations.test_results import seed_results
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.wrong_clocks import WrongClock, why_not

# A host that is three days ahead does what workers and the sweeper do.
_AHEAD = """
import json, sys
from datetime import UTC, datetime
from sqlalchemy import select
from service.pairs.sets import keep_set
from service.platform.db.models import CorrespondenceSet, Fleet
from service.platform.db.session import Database
from service.recordings.retention import delete_overdue
from service.platform.storage.blobs import condemn_lost
database = Database(sys.argv[1])
with database.writing() as session:
    fleet = Fleet(name="ahead")
    session.add(fleet)
    session.flush()
    known = session.scalars(select(CorrespondenceSet)).one()
    copied = ("fleet_id", "vehicle_id", "rig_id", "camera", "source", "notes", "pairs")
    for _ in range(2):
        keep_set(session, CorrespondenceSet(**{name: getattr(known, name) for name in copied}))
    condemn_lost(session)
print(json.dumps([delete_overdue(database), datetime.now(UTC).isoformat()]))
"""


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)  # SQLite asks the host
@pytest.mark.skipif(bool(why_not()), reason=f"no clock can be set here: {why_not()}")
def test_a_host_three_days_ahead_stamps_and_deletes_as_the_database_says(database: Database, tmp_path: Path):
    fleet = make_fleet(database)
    rig = seed_rig(database, fleet)
    recording, _ = seed_recording(database, rig, 1)
    seed_results(SimpleNamespace(database=database), rig, folds=())
    with database.writing() as session:
        session.add(Blob(key="on its way", state="reserved"))
        session.execute(update(Recording).values(retain_until=now(86400.0)))
        session.execute(update(CorrespondenceSet).values(pairs={"x": [1.0]}))
    command = [sys.executable, "-c", _AHEAD, database.engine.url.render_as_string()]
    clock = WrongClock(tmp_path, "ahead")
    clock.step(3 * 86400)
    said = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | clock.environment
    ).stdout
    deleted, believed = json.loads(said)
    with database.reading() as session:
        right = session.scalars(select(now())).one()
        assert datetime.fromisoformat(believed) - right > timedelta(days=2), "its clock was ahead"
        made = session.scalars(select(Fleet.created_at).where(Fleet.name == "ahead")).one()
        brought = session.scalars(
            select(CorrespondenceSet.brought_at).where(CorrespondenceSet.brought_at.is_not(None))
        ).one()
        assert abs(right - made) < timedelta(minutes=5)
        assert abs(right - brought) < timedelta(minutes=5)
        assert session.get_one(Blob, "on its way").state == "reserved"
        assert deleted == 0 and session.get(Recording, recording) is not None
