"""Where requests go: every id and name stays the one segment of the path that it is given for."""

import inspect
from collections.abc import Iterator

import pytest

from apexcal.client import Client, InputError, TokenError
from apexcal.transport import HttpTransport, at

HOSTILE = "../../fleets?a=b#c"


class SeenError(Exception):
    """Raised before a request is sent."""


@pytest.mark.parametrize(
    ("segment", "path"),
    [
        ("..", "/a/%2E%2E/b"),
        (".", "/a/%2E/b"),
        ("x/../y", "/a/x%2F..%2Fy/b"),
        ("?q#f", "/a/%3Fq%23f/b"),
        (7, "/a/7/b"),
    ],
)
def test_a_segment_stays_one(segment, path):
    assert at("a", segment, "b") == path


def calls(client: Client) -> Iterator[tuple[str, object, dict[str, object]]]:
    """Every method that takes an id, with hostile text for its ids and camera names."""
    for name in ("fleets", "vehicles", "recordings", "detections", "marking", "correspondence_sets", "calibrations"):
        for method_name, method in inspect.getmembers(getattr(client, name), inspect.ismethod):
            wanted = inspect.signature(method).parameters
            required = [
                each for each in wanted.values() if each.default is each.empty and each.kind != each.VAR_KEYWORD
            ]
            files = {"path", "target", "recording"} & {each.name for each in required}
            if method_name.startswith("_") or files or not any(each.name.endswith("_id") for each in required):
                continue
            fill = {"index": 3, "u": 1.0, "v": 1.0, "version": 1, "region": {}, "rig": {}, "policy": {}, "pairs": []}
            fill |= {"text": b"", "serials": {}, "cameras": {}}
            yield f"{name}.{method_name}", method, {each.name: fill.get(each.name, HOSTILE) for each in required}


def test_no_method_lets_an_id_lead_elsewhere():
    seen: list[str] = []

    def look(request):
        seen.append(request.url.raw_path.decode())
        raise SeenError

    with Client("http://127.0.0.1:9", "apx_x") as client:
        client._http._http.event_hooks["request"].append(look)
        for name, method, arguments in calls(client):
            with pytest.raises(SeenError):
                next(iter(method(**arguments)))
            path = seen[-1].split("?")[0]
            assert path.startswith("/v1/"), name
            assert "..%2F..%2Ffleets%3Fa%3Db%23c" in path.split("/"), name
            assert ".." not in path.split("/"), name
    assert len(seen) > 35


@pytest.mark.parametrize("token", ["é", "two words", "line\n", "\udce9"])
def test_a_token_that_no_header_carries_is_said(token):
    with pytest.raises(TokenError, match="ASCII"):
        HttpTransport("http://127.0.0.1:9", token)


def test_a_number_that_json_cannot_hold_is_said_where_it_stands():
    with Client("http://127.0.0.1:9") as client, pytest.raises(InputError, match=r"^priors\.f_x\.1 is not a finite"):
        client.calibrations.create("vehicle", ["set"], priors={"f_x": (500.0, float("inf"))})
