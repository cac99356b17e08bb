"""Log lines: one object each, with the request they belong to, and nothing that a request keeps secret."""

from __future__ import annotations

import io
import json
import logging
import sys

import pytest

from service.platform.observability import request_ids
from service.platform.observability.logs import about, formatter
from tests.support.people import Api


@pytest.fixture
def written():
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(formatter("json"))
    logger = logging.getLogger("service")
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    yield lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
    logger.removeHandler(handler)
    logger.setLevel(level)


def test_a_line_is_one_object_whatever_was_logged(written) -> None:
    log = logging.getLogger("service.somewhere")
    with request_ids.working_for("r-1"), about(job=7):
        log.warning("two\nlines and %s", {"a": "\x00"}, extra={"ms": 1.5})
        try:
            raise ValueError("bad")
        except ValueError:
            log.exception("failed")
    log.info("outside")
    first, second, third = written()
    assert (first["request_id"], first["job"], first["level"], first["ms"]) == ("r-1", 7, "WARNING", 1.5)
    assert first["message"].startswith("two\nlines") and first["time"].endswith("Z")
    assert "ValueError: bad" in second["exception"]
    assert "request_id" not in third and "job" not in third


def test_a_line_for_people_says_what_it_is_about() -> None:
    record = logging.LogRecord("service", logging.INFO, "", 0, "hello", (), None)
    with request_ids.working_for("r-1"):
        assert "service [request_id=r-1] hello" in formatter("text").format(record)
    assert "service hello" in formatter("text").format(record)


@pytest.mark.parametrize("given", ["abc-1.2_3", "x" * 64])
def test_a_callers_id_is_kept_and_answered(api: Api, written, given: str) -> None:
    answer = api.owner().get("/jobs?limit=1&secret=hidden", headers={request_ids.HEADER: given})
    assert answer.headers[request_ids.HEADER] == given
    (line,) = written()
    assert (line["request_id"], line["path"], line["status"], line["method"]) == (given, "/v1/jobs", 422, "GET")
    assert "hidden" not in json.dumps(line) and "apx_" not in json.dumps(line)


@pytest.mark.parametrize("given", ["", "x" * 65, "a b", 'quote"', "line\u2028"])
def test_an_id_that_could_do_harm_is_replaced(api: Api, written, given: str) -> None:
    answer = api.owner().get("/jobs", headers={request_ids.HEADER: given.encode()})
    made = answer.headers[request_ids.HEADER]
    assert made != given and len(made) == 32 and written()[-1]["request_id"] == made
    assert api.owner().get("/jobs").headers[request_ids.HEADER] != made


def test_a_failure_that_nobody_foresaw_can_be_found_by_its_id(api: Api, written, monkeypatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("service.platform.job_status.routes.fetch", fail)
    answer = api.owner().get("/jobs", headers={request_ids.HEADER: "find-me"})
    assert answer.status_code == 500
    assert answer.json()["request_id"] == answer.headers[request_ids.HEADER] == "find-me"
    assert {line["request_id"] for line in written()} == {"find-me"}
    assert any("ZeroDivisionError" in line.get("exception", "") for line in written())


FORGED = "GET /\n2026-01-01 00:00:00,000 ERROR service forged\r\x1b[2J\u2028\u202e\x9b\udc80"


def test_a_line_for_people_stays_one_line_whatever_is_in_it() -> None:
    record = logging.LogRecord("service", logging.INFO, "", 0, "%s came", (FORGED,), None)
    with about(kind="a\nb"):
        line = formatter("text").format(record)
    assert line.isprintable() and line.endswith("came") and "kind=a\\nb" in line
    try:
        raise ValueError(FORGED)
    except ValueError:
        record.exc_info = sys.exc_info()
    first, *below = formatter("text").format(record).splitlines()
    assert first.isprintable() and below
    assert all(line.startswith("  ") and line.isprintable() for line in below)
    assert "ValueError: GET /" in below[-2] or "ValueError: GET /" in below[-1]


def test_a_line_for_machines_orders_no_terminal_and_says_the_same() -> None:
    record = logging.LogRecord("service", logging.INFO, "", 0, FORGED, (), None)
    line = formatter("json").format(record)
    assert line.isprintable() and json.loads(line)["message"] == FORGED
