"""Hints go out after the commit, to the fleet that they are about, and never hurt a request."""

import json
from uuid import UUID

import httpx
import pytest

from service.platform.broker import hints
from service.platform.broker.hints import COURIER, Publisher, channel, hint
from tests.support.broker import Broker
from tests.support.people import Api
from tests.support.processes import wait_until


def heard(api: Api, subscription, fleet: UUID) -> list[dict]:
    """What arrives before a hint that is given now: hints of a fleet keep their order."""
    with api.database.writing() as session:
        hint(session, fleet, "last", 0)
    found: list[dict] = []

    def last_came() -> bool:
        message = subscription.get_message(timeout=0.1)
        if message and message["type"] == "message":
            found.append(json.loads(message["data"]))
        return found[-1:] == [{"kind": "last", "id": "0"}]

    wait_until(last_came, "the last hint")
    return found[:-1]


def test_a_change_is_told_to_its_fleet_once(api: Api, broker: Broker) -> None:
    mine, other = api.fleet(), api.fleet()
    with broker.client() as client, client.pubsub() as subscription:
        subscription.subscribe(channel(mine), channel(other))
        subscription.get_message(timeout=1)
        made = api.member(mine, "engineer").post(f"/fleets/{mine}/vehicles", {"name": "van"}).json()
        assert heard(api, subscription, mine) == [{"kind": "vehicle", "id": made["id"]}]
        with api.database.writing() as session:
            hint(session, other, "job", 7)
            hint(session, other, "job", 7)
        assert heard(api, subscription, other) == [{"kind": "job", "id": "7"}]


def test_what_is_rolled_back_is_not_told(api: Api, broker: Broker) -> None:
    fleet = api.fleet()
    with broker.client() as client, client.pubsub() as subscription:
        subscription.subscribe(channel(fleet))
        try:
            with api.database.writing() as session:
                hint(session, fleet, "job", 7)
                raise KeyError
        except KeyError:
            pass
        assert heard(api, subscription, fleet) == []


def test_an_absent_broker_is_tried_once_and_then_left_alone(
    api: Api, broker: Broker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """An attempt may take half a second; each request would wait for its own."""
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    broker.stop()
    monkeypatch.setattr(hints, "_QUIET_S", 3600.0)
    api.database.couriers[COURIER] = publisher = Publisher(f"unix://{broker.socket}?db=0")
    for number in range(20):
        assert engineer.post(f"/fleets/{fleet}/vehicles", {"name": f"van {number}"}).status_code == 201
    assert sum("hints are lost" in one.getMessage() for one in caplog.records) == 1
    publisher.close()


def test_followers_hear_of_changes_and_of_a_broker_that_came_back(served, broker: Broker) -> None:
    api, url = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    headers = {"Authorization": f"Bearer {engineer.token}"}
    with (
        httpx.Client(base_url=url, headers=headers, timeout=60) as client,
        client.stream("GET", f"/v1/fleets/{fleet}/events") as stream,
    ):
        assert stream.headers["content-type"].startswith("text/event-stream")
        events = parsed(stream)
        assert next(events) == ("changed", {"kind": "fleet", "id": str(fleet)})
        wait_for_subscriptions(broker)
        made = httpx.post(f"{url}/v1/fleets/{fleet}/vehicles", json={"name": "van"}, headers=headers).json()
        assert next(events) == ("changed", {"kind": "vehicle", "id": made["id"]})
        broker.stop()
        broker.start()
        assert next(events) == ("changed", {"kind": "fleet", "id": str(fleet)})


def parsed(stream):
    name = ""
    for line in stream.iter_lines():
        if line.startswith("event:"):
            name = line.removeprefix("event:").strip()
        if line.startswith("data:"):
            yield name, json.loads(line.removeprefix("data:"))


def wait_for_subscriptions(broker: Broker) -> None:
    """Of the server, and of the test's own client, in which the application lives too."""
    with broker.client() as client:
        wait_until(lambda: len(client.client_list(_type="pubsub")) == 2, "the subscriptions")
