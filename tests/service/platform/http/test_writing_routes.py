"""Each route that writes gives up in time where what it wants to change stays locked."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from sqlalchemy import text

from service.platform.db.models import Base
from service.platform.http.threads import WAIT_S
from tests.service.platform.auth.test_every_route import fill, routes, send
from tests.support.people import Api

# Who asks is looked up in these.
IDENTITY = {"person", "membership", "api_token"}
# These ask the database for nothing.
COMPUTED = {"/v1/calibration-files/reading"}
# These only read, which SQLite allows beside a writer, or refuse before they write, or have nothing to write.
ONLY_READING = {
    "/v1/recordings/{id}/parts/{number}/address",
    "/v1/recordings/{id}/parts/{number}/arrival",
    "/v1/recordings/{recording_id}/rig-proposals",
    "/v1/results/{result_id}/comparison",
    "/v1/results/{result_id}/urdf",
    "/v1/vehicles/{vehicle_id}/calibrations",
    "/v1/vehicles/{vehicle_id}/cameras/{camera}/calibration/urdf",
}
READS = ("get", "head")


def test_each_writing_route_gives_up_a_lock_in_time(api: Api) -> None:
    fleet = api.fleet()
    api.member(fleet, "admin")
    with api.database.writing() as session:
        rows = fill(session, fleet)
    writing = [(*route, api.owner()) for route in routes() if route[0] not in READS]

    def ask(route: Any) -> tuple[str, str, int, str, float]:
        method, path, operation, person = route
        began = time.monotonic()
        answer = send(api, person, method, path, operation, rows)
        code = answer.json().get("code", "") if answer.content else ""
        return method, path, answer.status_code, code, time.monotonic() - began

    with api.database.writing() as session, ThreadPoolExecutor(len(writing)) as pool:
        has_one_writer = api.database.engine.dialect.name == "sqlite"
        if has_one_writer:
            session.execute(text("SELECT 1"))
        else:
            names = ", ".join(f'"{name}"' for name in sorted(set(Base.metadata.tables) - IDENTITY))
            session.execute(text(f"LOCK TABLE {names} IN ACCESS EXCLUSIVE MODE"))
        # Apart: a call that met a lock waits for one of few threads, and those that need no lock are not to wait too.
        answers = list(pool.map(ask, [route for route in writing if route[1] in COMPUTED | ONLY_READING]))
        answers += pool.map(ask, [route for route in writing if route[1] not in COMPUTED | ONLY_READING])
    print(f"{len(answers)} routes, the slowest in {max(one[-1] for one in answers):.2f} s")
    assert len(answers) > 40
    assert not [one for one in answers if one[-1] > 3 * WAIT_S - 1], "a thread and a lock are waited for together"
    others = {path: (status, code) for _, path, status, code, _ in answers if code not in ("locked", "busy")}
    assert set(others) == COMPUTED | (ONLY_READING if has_one_writer else set()), others
