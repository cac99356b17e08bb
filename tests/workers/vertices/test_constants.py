"""docs/constants.md has one row for every number at the top of a file of workers/vertices, and no other."""

import ast
import re

from tests.support.places import ROOT

ROOM = ROOT / "workers" / "vertices"
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")


def _names(target):
    parts = target.elts if isinstance(target, ast.Tuple) else [target]
    return [part.id for part in parts if isinstance(part, ast.Name) and CONSTANT.fullmatch(part.id)]


def in_code():
    """``file constant`` of every assignment at the top of a file to a name in capitals, but tables of functions."""
    found = set()
    for path in ROOM.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            targets = {ast.Assign: lambda n: n.targets, ast.AnnAssign: lambda n: [n.target]}.get(type(node))
            if targets is not None and not _is_table_of_functions(node.value):
                found |= {f"{path.relative_to(ROOM)} {name}" for target in targets(node) for name in _names(target)}
    return found


def _is_table_of_functions(value):
    """``RUNS`` names functions; it holds no number."""
    numbers = [n for n in ast.walk(value) if isinstance(n, ast.Constant) and isinstance(n.value, int | float)]
    return isinstance(value, ast.Dict) and not numbers


def in_docs():
    rows, file = [], ""
    for line in (ROOT / "docs" / "constants.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) == 3 and cells[1].startswith("`"):
            file = cells[0].strip("`") or file
            assert len(cells[2]) > 3, line
            rows += [f"{file} {name}" for name in re.findall(r"`([^`]+)`", cells[1])]
    return rows


def test_every_constant_says_where_it_comes_from():
    rows = in_docs()
    assert sorted(rows) == sorted(set(rows)), "a constant has two rows"
    assert in_code() - set(rows) == set(), "give it a row in docs/constants.md"
    assert set(rows) - in_code() == set(), "these are gone: remove them from docs/constants.md"
    assert len(rows) > 50
