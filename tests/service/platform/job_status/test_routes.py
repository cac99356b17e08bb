"""Whether workers answer, as pages and programs ask it."""

from service.platform.db.clock import now
from service.platform.db.jobs import Worker
from service.platform.jobs.queue import SILENT_S
from tests.support.people import Api


def say(api: Api, name: str, queues: str, ago_s: float = 0.0, warm: bool = True) -> None:
    about = {"processes": 1, "version": "0", "started_at": now(-60.0)}
    with api.database.writing() as session:
        session.merge(Worker(name=name, queues=queues, warm=warm, at=now(-ago_s), **about))


def test_kinds_that_no_answering_worker_takes_are_named(api: Api) -> None:
    viewer = api.member(api.fleet(), "viewer")
    nobody = viewer.get("/workers").json()
    assert nobody["answering"] == 0 and {"ingest", "detect", "solve", "report"} <= set(nobody["unserved"])
    say(api, "reader", "ingest")
    say(api, "computing", "detect,solve,report", warm=False)  # it compiles its kernels, and answers
    assert viewer.get("/workers").json() == {"answering": 2, "unserved": []}
    say(api, "reader", "ingest", ago_s=SILENT_S + 1.0)
    assert viewer.get("/workers").json() == {"answering": 1, "unserved": ["ingest", "calibrated_copy"]}
