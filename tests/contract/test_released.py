"""From 1.0.0 on the API and the database only grow: what was released is still there, and means the same.

``python -m tests.contract.test_released > tests/contract/released.json`` writes the digest anew, at a release alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from copy import deepcopy
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml

from service.openapi import document
from service.platform.db.models import Base
from tests.support.places import ROOT

FILE = Path(__file__).with_name("released.json")
Digest = dict[str, Any]


def kind(schema: dict[str, Any]) -> str:
    """A member's kind in a word or a few: ``string``, ``Camera[]``, ``number|null``."""
    if "$ref" in schema:
        return schema["$ref"].rpartition("/")[2]
    if choices := schema.get("anyOf", schema.get("oneOf")):
        return "|".join(sorted(map(kind, choices)))
    if schema.get("type") == "array":
        return kind(schema.get("items", {})) + "[]"
    return schema.get("type", "const" if "const" in schema else "any")


def within(schema: Any) -> Iterator[str]:
    """Names of the documents that a schema refers to itself."""
    for key, value in schema.items() if isinstance(schema, dict) else enumerate(schema):
        if key == "$ref":
            yield value.rpartition("/")[2]
        elif isinstance(value, dict | list):
            yield from within(value)


def digest() -> Digest:
    """What is promised: operations, members of documents (``!``: a request must have it), columns of tables."""
    described = json.loads(document())
    schemas, operations, sent = described["components"]["schemas"], {}, set()
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            operations[operation["operationId"]] = f"{method.upper()} {path}"
            sent |= set(within(operation.get("requestBody", {})))
    grown = set()
    while grown != sent:
        grown, sent = sent, sent | {inner for name in sent for inner in within(schemas[name])}
    documents = {
        name: {
            member: kind(of) + ("!" if name in sent and member in schema.get("required", ()) else "")
            for member, of in schema["properties"].items()
        }
        for name, schema in schemas.items()
        if "properties" in schema
    }
    tables = {
        table.name: {
            column.name: f"{column.type.__class__.__name__}{'' if column.nullable or column.server_default else '!'}"
            for column in table.columns
        }
        for table in Base.metadata.sorted_tables
    }
    return {"operations": operations, "documents": documents, "tables": tables}


def broken(before: Digest, now: Digest) -> list[str]:
    """Promises that are not kept: what is gone or another thing, and what is demanded that was not."""
    gone = [
        f"{part}: {name}"
        for part in ("operations", "documents", "tables")
        for name in before[part]
        if name not in now[part]
    ]
    moved = [name for name, where in before["operations"].items() if now["operations"].get(name, where) != where]
    changed, demanded = [], []
    for part in ("documents", "tables"):
        for name, members in before[part].items():
            today = now[part].get(name, members)
            changed += [
                f"{name}.{member}"
                for member, of in members.items()
                if today.get(member, "").rstrip("!") != of.rstrip("!")
            ]
            demanded += [
                f"{name}.{member}"
                for member, of in today.items()
                if of[-1] == "!" and members.get(member, "")[-1:] != "!"
            ]
    return gone + moved + changed + demanded


def test_what_was_released_is_still_there() -> None:
    hint = (
        "Keep it, or add beside it (docs/decisions/0021): a member that may be left out, a column that may be null."
    )
    assert broken(json.loads(FILE.read_text()), digest()) == [], hint


@pytest.mark.parametrize(
    ("part", "name", "change", "says"),
    [
        ("operations", "vehicles.list", None, "operations: vehicles.list"),
        ("operations", "vehicles.list", "GET /v1/cars", "vehicles.list"),
        ("documents", "VehicleOut", {"id": "integer"}, "VehicleOut.id"),
        ("documents", "NewRig", {"colour": "string!"}, "NewRig.colour"),
        ("tables", "job", {"mood": "String!"}, "job.mood"),
        ("documents", "NewRig", {"colour": "string"}, None),
        ("tables", "job", {"mood": "String"}, None),
    ],
)
def test_each_breach_is_named_and_growth_is_none(part: str, name: str, change: Any, says: str | None) -> None:
    before = json.loads(FILE.read_text())
    now = deepcopy(before)
    if isinstance(change, dict):
        now[part][name] |= change
    elif change:
        now[part][name] = change
    else:
        del now[part][name]
    assert broken(before, now) == ([says] if says else [])


def test_the_version_is_one_everywhere() -> None:
    number = version("apexcal")
    assert number == json.loads((ROOT / "frontend" / "package.json").read_text())["version"]
    assert number == yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    assert f"\n## {number}\n" in (ROOT / "CHANGELOG.md").read_text()
    images = {
        service["image"].partition(":")[::2]
        for service in yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"].values()
        if "build" in service
    }
    assert images == {("apexcal-serve", number), ("apexcal-worker", number)}


if __name__ == "__main__":
    # A line for each operation, document and table: a change shows as what it is.
    parts = [
        f'"{part}": {{\n' + ",\n".join(f" {json.dumps(name)}: {json.dumps(of)}" for name, of in names.items()) + "\n}"
        for part, names in digest().items()
    ]
    print("{" + ",\n".join(parts) + "}")
