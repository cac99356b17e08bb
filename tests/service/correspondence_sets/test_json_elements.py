"""A list is read one element at a time: what json reads, and nothing that costs more."""

import json
import random
import time
import tracemalloc

import pytest

from service.correspondence_sets.json_elements import NoDocumentError, elements_of
from service.correspondence_sets.pair_files import read_json
from service.platform.http.problems import Problem

PAIR = {"x": 1.5, "y": -2e-7, "z": 3, "u": 4.25, "v": 5, "group": 'ä"\\\n', "more": [1, {"a": None}], "flag": True}
MIB = 1024 * 1024


def read(body: bytes) -> object:
    try:
        return list(elements_of(body, "pairs"))
    except NoDocumentError:
        return None


def read_by_json(body: bytes) -> object:
    """What json makes of it; None where it is no JSON, or no object with one such list."""
    try:
        members = json.loads(body, object_pairs_hook=lambda found: found)
    except (ValueError, RecursionError):
        return None
    if not (isinstance(members, list) and body.strip().startswith(b"{")):
        return None
    if [name for name, _ in members].count("pairs") != 1:
        return None
    pairs = json.loads(body)["pairs"]
    return pairs if isinstance(pairs, list) else None


@pytest.mark.parametrize("indent", [None, 0, 3])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_elements_are_those_of_json(indent: int | None, encoding: str) -> None:
    document = {"id": "7", "notes": ["a" * 3000], "pairs": [PAIR] * 700, "after": {}}
    body = json.dumps(document, indent=indent, ensure_ascii=False).encode(encoding)
    assert read(body) == document["pairs"]


def test_what_json_refuses_is_refused_and_what_it_reads_is_read() -> None:
    whole = json.dumps({"a": [1], "pairs": [PAIR, PAIR, [], 7], "b": "c"}).encode()
    made = random.Random(7)
    for _ in range(3000):
        body = bytearray(whole)
        for _ in range(made.randint(1, 3)):
            at = made.randrange(len(body))
            body[at : at + made.randint(0, 2)] = made.choice([b"", b",", b"]", b"}", b'"', b" ", b"1", b"[", b"\xff"])
        assert read(bytes(body)) == read_by_json(bytes(body)), bytes(body)


@pytest.mark.parametrize(
    "body",
    [
        b'{"pairs":[' + b'{"":[]},' * MIB + b"{}]}",
        b'{"pairs":[{"x":' + b'[{"":[]},' * MIB,
        b'{"pairs":[{"x":' + b"[" * 8 * MIB,
        b'{"pairs":[{"x":' + b"9" * 8 * MIB + b"}]}",
        b'{"a":[' + b'{"":[]},' * MIB + b'{}],"pairs":[]}',
        b'[' + b'{"":[]},' * MIB + b"{}]",
    ],
    ids=["many", "in one", "deep", "a number", "in another member", "no object"],
)  # fmt: skip
def test_eight_hostile_megabytes_cost_little(body: bytes) -> None:
    began = time.process_time()
    tracemalloc.start()
    with pytest.raises(Problem):
        read_json(body)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.process_time() - began < 1.0
    assert peak < 24 * MIB, "its text, and little else"
