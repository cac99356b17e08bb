"""The campaign itself: a calm phase that says what is right, the storm, the quiet after it, and the check."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import timedelta
from math import ceil
from pathlib import Path
from random import Random
from typing import Any
from uuid import UUID

from sqlalchemy import func, select, text, update
from sqlalchemy.exc import OperationalError

from benchmarks.campaign.clients import Annotator, Engineer, GaveUpError
from benchmarks.campaign.invariants import Findings, check
from benchmarks.campaign.kinds import KINDS, NEED_A_NETWORK, OF_HOSTS
from benchmarks.campaign.ledger import Ledger
from benchmarks.campaign.plant import CLOCKS_APART_S, Plant
from benchmarks.campaign.requests import CALIBRATIONS, Expected, record, sensors, vertices
from benchmarks.campaign.schedule import Injector, draw, say
from service.platform.db.models import Blob, Calibration, Detection, Job, Recording
from service.platform.storage.audit import audit
from tests.faults.results import documents
from tests.support.networks import Network
from tests.support.people import add_person

_TICK_S = 0.05
_CALM_S = 240.0
# Longer than a job ever waits to be tried again, which is 128 s: what has not moved for so long never will.
_NOTHING_MOVES_S = 150.0
_LONGER_THAN_ANY_UPLOAD_US = 3 * 3600 * 1_000_000
# Clients begin their last request when this share of the time is over.
_ASKED_UNTIL = 0.85
# How many clients work at once, by what they do.
_CLIENTS = {"calibrations": 4, "uploads": 4, "marks": 4}


@dataclass(frozen=True)
class Size:
    """How long it takes and how much is under way. ``calibrations`` counts those of the storm."""

    seconds: float
    fault_every_s: float
    calibrations: int
    uploads: int
    marks: int
    walks: int

    @property
    def quiet_s(self) -> float:
        """How long everything may take to end after the last fault, on a machine that is busy with other things."""
        return max(600.0, 2 * self.seconds)


class Campaign:
    """One run. The thread that makes it must run and close it: the processes end with that thread."""

    def __init__(
        self,
        data: Path,
        logs: Path,
        random: Random,
        size: Size,
        *,
        own_disk: bool,
        s3: bool,
        network: Network | None,
        of_hosts: bool = False,
    ) -> None:
        self._random = random
        self._size = size
        # A disk that belongs to others as well is not filled.
        left_out = {*(() if own_disk else ("disk_full",)), *(() if network else NEED_A_NETWORK)}
        left_out |= {"store_host_vanished"} if not s3 else set()
        self._kinds = [kind for kind in (sorted(OF_HOSTS) if of_hosts else KINDS) if kind not in left_out]
        self._ledger = Ledger()
        self._expected = Expected()
        with ThreadPoolExecutor(1) as pool:
            walks = pool.submit(record, logs, size.walks)
            self._plant = Plant(data, logs, random, s3=s3, network=network)
            self._walks = walks.result()
        self._store = self._plant.store()
        self._injected: dict[str, int] = {}
        self._left_to_audit = 0

    def run(self) -> Findings:
        """Everything from the first process to the last check."""
        began = time.monotonic()

        def after(what: str) -> None:
            say(f"{what} after {time.monotonic() - began:.0f} s")

        token = self._plant.begin()
        self._plant.wait_ready()
        after("ready")
        until = time.monotonic() + _CALM_S + self._size.seconds + self._size.quiet_s
        engineer = Engineer(self._plant.url, token, self._ledger, until)
        recordings = self._calm(engineer)
        after("undisturbed work done")
        self._storm(engineer, self._annotators(engineer, sum(recordings.values()), until), recordings)
        after("all asked for, nothing strikes any more")
        self._quiet()
        after("quiet")
        return self._check()

    def facts(self) -> dict[str, Any]:
        """What was done, for the line of JSON."""
        return {
            "faults_injected": sum(self._injected.values()),
            "faults": dict(sorted(self._injected.items())),
            "store": "s3" if self._plant.s3 else "folder",
            "kinds_left_out": sorted(set(KINDS) - set(self._kinds)),
            "clocks_apart_s": CLOCKS_APART_S,
            "calibrations": len(self._ledger.calibrations),
            "uploads": len(self._ledger.completed),
            "detections": len(self._ledger.detections),
            "marks": len(self._ledger.marks),
            "left_to_audit": self._left_to_audit,
            "answers": dict(sorted(self._ledger.answers.items())),
        }

    def close(self) -> None:
        """Stop every process."""
        self._plant.close()

    def _calm(self, engineer: Engineer) -> dict[UUID, int]:
        """Do each distinct request once, undisturbed. Returns the recordings with their numbers of frames."""
        with ThreadPoolExecutor(1) as pool:
            asked = {kind: pool.submit(engineer.calibrate, kind) for kind in CALIBRATIONS}
            sent = {name: pool.submit(engineer.upload, name, walk) for name, walk in self._walks.items()}
            self._watch_until(lambda: all(one.done() for one in (*asked.values(), *sent.values())), _CALM_S)
        assert self._watch_until(lambda: not self._unended(), _CALM_S), "undisturbed work did not end"
        with self._plant.database.reading() as session:
            for kind, one in asked.items():
                self._expected.calibrations[kind] = documents(session, one.result())
            for name, one in sent.items():
                row = session.get_one(Recording, one.result())
                self._expected.recordings[name] = sensors(session, self._store, row)
            for detection_id, name in self._ledger.detections.items():
                self._expected.detections[name] = vertices(session, session.get_one(Detection, detection_id))
        assert all(self._expected.calibrations.values()), "undisturbed calibrations found nothing"
        return {one.result(): engineer.frames(one.result()) for one in sent.values()}

    def _annotators(self, engineer: Engineer, frames: int, until: float) -> list[Annotator]:
        """People enough for the marks: each has one place in each frame, and some of the places stay empty."""
        made: list[Annotator] = []
        for number in range(max(8, ceil(1.25 * self._size.marks / frames))):
            roles = dict.fromkeys(engineer.fleets, "annotator")
            person, secret = add_person(self._plant.database, f"annotator {number}", roles=roles)
            made.append(Annotator(person, self._plant.url, secret, self._ledger, until))
        return made

    def _storm(self, engineer: Engineer, annotators: list[Annotator], recordings: dict[UUID, int]) -> None:
        """Clients ask for everything while the schedule strikes; it ends when both have ended."""
        planned = draw(self._random, self._size.seconds, self._size.fault_every_s, self._kinds)
        work = {
            "calibrations": [self._calibration(engineer) for _ in range(self._size.calibrations)],
            "uploads": [self._upload(engineer) for _ in range(self._size.uploads)],
            "marks": self._marks(annotators, recordings),
        }
        pools = {name: ThreadPoolExecutor(clients) for name, clients in _CLIENTS.items()}
        began = time.monotonic()
        under_way: list[Future[None]] = []
        for name, tasks in work.items():
            for number, task in enumerate(tasks):
                begin = began + self._size.seconds * _ASKED_UNTIL * number / len(tasks)
                under_way.append(pools[name].submit(self._at, begin, task))
        injector = Injector(self._plant, planned, self._random)
        while not injector.finished:
            injector.step()
            time.sleep(_TICK_S)
        self._injected = dict(injector.injected)
        self._watch_until(lambda: all(one.done() for one in under_way), self._size.quiet_s)
        for pool in pools.values():
            pool.shutdown(cancel_futures=True)
        for one in under_way:
            one.result()

    def _at(self, begin: float, task: Callable[[], object]) -> None:
        time.sleep(max(0.0, begin - time.monotonic()))
        try:
            task()
        except GaveUpError as error:
            with self._ledger.lock:
                self._ledger.never_answered.append(str(error))
        except Exception as error:
            with self._ledger.lock:
                self._ledger.never_answered.append(f"refused: {error!r}")

    def _calibration(self, engineer: Engineer) -> Callable[[], object]:
        kind = self._random.choice(list(CALIBRATIONS))
        return lambda: engineer.calibrate(kind)

    def _upload(self, engineer: Engineer) -> Callable[[], object]:
        name = self._random.choice(list(self._walks))
        return lambda: engineer.upload(name, self._walks[name])

    def _marks(self, annotators: list[Annotator], recordings: dict[UUID, int]) -> list[Callable[[], object]]:
        """Marks of different people in different frames, as many as wanted."""
        places = [
            (person, recording, frame)
            for person in annotators
            for recording, frames in recordings.items()
            for frame in range(frames)
        ]
        chosen = self._random.sample(places, self._size.marks)
        return [self._mark(person, recording, frame) for person, recording, frame in chosen]

    def _mark(self, person: Annotator, recording: UUID, frame: int) -> Callable[[], object]:
        u, v = round(self._random.uniform(0, 950), 2), round(self._random.uniform(0, 590), 2)
        corrected = self._random.random() < 0.25
        return lambda: person.mark(recording, frame, u, v, corrected)

    def _quiet(self) -> None:
        """Wait until nothing is left to do. What clients left of broken uploads is as old as if hours had passed."""
        self._plant.wait_ready()  # the last strike may have been at the database
        with self._plant.database.writing() as session:
            left = (Blob.state == "reserved") & Blob.job_id.is_(None)
            older = Blob.created_at - text(str(_LONGER_THAN_ANY_UPLOAD_US))
            session.execute(update(Blob).where(left).values(created_at=older))
        last, since = -1, time.monotonic()

        def over() -> bool:
            nonlocal last, since
            if not self._unended() and not self._to_remove():
                return True
            moved = self._moves()
            if moved != last:
                last, since = moved, time.monotonic()
            return time.monotonic() - since > _NOTHING_MOVES_S

        self._watch_until(over, self._size.quiet_s)

    def _check(self) -> Findings:
        self._plant.stop_service()
        # What a process wrote after its row was given up is the audit's, which looks a day later.
        audited = audit(self._plant.database, self._store, timedelta(0), remove=True)
        self._left_to_audit = audited.removed
        keys = [one.key for one in self._store.list()]
        with self._plant.database.reading() as session:
            found = check(session, self._store, keys, self._ledger, self._expected)
        found.orphans += [f"left in the scratch folder: {name}" for name in self._scratch()]
        return found

    def _unended(self) -> int:
        """Rows that something has still to happen to."""
        waiting = ("queued", "running", "ingesting")
        with self._plant.database.reading() as session:
            return sum(
                session.scalar(select(func.count()).where(table.state.in_(waiting))) or 0
                for table in (Job, Calibration, Recording, Detection)
            )

    def _moves(self) -> int:
        """A number that grows with everything that happens to a job."""
        with self._plant.database.reading() as session:
            return (
                session.scalar(select(func.count(Job.finished_at) + func.sum(Job.attempt) + func.sum(Job.lost))) or 0
            )

    def _to_remove(self) -> int:
        with self._plant.database.reading() as session:
            rows = session.scalar(select(func.count()).where(Blob.state != "stored")) or 0
        return rows + len(self._scratch())

    def _scratch(self) -> list[str]:
        folder = self._plant.folder / "scratch"
        return [path.name for path in folder.iterdir()] if folder.is_dir() else []

    def _watch_until(self, true: Callable[[], bool], seconds: float) -> bool:
        """Keep the plant running until it is true. Returns whether it became true in time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._plant.watch()
            try:
                if true():
                    return True
            except OperationalError:
                pass  # the database is starting again
            time.sleep(_TICK_S * 4)
        return False
