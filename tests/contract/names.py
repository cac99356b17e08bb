"""Names of the product: a class name stands once, and names that say nothing do not grow in number.

`make check` runs this: python -m tests.contract.names. CONTRIBUTING.md has the glossary that names come from.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.support.places import ROOT

PRODUCT = ("apexcal", "service", "workers")

# A table's row may bear the name of the document that it stores.
ROWS = "service/platform/db/"

# Class names that still stand twice. A name that no longer does is taken out; none is added.
TWICE = frozenset(
    [
        "Box",
        "InputError",
    ]
)

# Participles and pronouns that do not say what a thing is, as names of variables, parameters, members and functions.
SAY_NOTHING = frozenset(
    [
        "asked",
        "found",
        "given",
        "held",
        "kept",
        "known",
        "made",
        "one",
        "place",
        "said",
        "seen",
        "told",
        "wanted",
        "written",
    ]
)

# How often each room may use them. Later changes lower these numbers.
CEILINGS = {
    "apexcal": 2,
    "frontend/src/components": 24,
    "frontend/src/lib": 92,
    "frontend/src/pages": 119,
    "service": 0,
    "service/platform": 2,
    "workers": 0,
    "workers/geometry": 4,
    "workers/judge": 0,
    "workers/marks": 0,
    "workers/models": 0,
    "workers/readers": 0,
    "workers/reports": 0,
    "workers/simulation": 0,
    "workers/solver": 2,
    "workers/tasks": 0,
    "workers/vertices": 0,
}


# What may stand before the name that TypeScript declares: a keyword, a parameter's place, an each block of Svelte.
_DECLARED = re.compile(r"\b(?:const|let|function|class)\s+(\w+)|\b(\w+)\s*=>|\{#each\b[^}]*?\bas\s+(\w+)")
_UNPACKED = re.compile(r"\b(?:const|let)\s*[\[{]([^=;]*?)[\]}]\s*=")
_PARAMETERS = re.compile(r"\(([^()]*)\)\s*(?::[^=;{}()]*)?(?:=>|\{)")
_COMMENT = re.compile(r"/\*.*?\*/|(?<!:)//[^\n]*|<!--.*?-->", re.DOTALL)


def main() -> int:
    """Print what is wrong, and what may be lowered; 1 if something is wrong."""
    classes: defaultdict[str, set[str]] = defaultdict(set)
    counts: Counter[str] = Counter()
    for path, tree in modules():
        room = max((name for name in CEILINGS if path.startswith(name + "/")), key=len, default=None)
        if room is None:
            print(f"{path}: its room has no ceiling in {Path(__file__).name}")
            return 1
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and not path.startswith(ROWS):
                classes[node.name].add(path)
            counts[room] += name_of(node) in SAY_NOTHING
    for room, text in pages():
        counts[room] += sum(name in SAY_NOTHING for name in names_of_page(text))
    repeated = {name: ", ".join(sorted(paths)) for name, paths in classes.items() if len(paths) > 1}
    wrong = [f"the class name {name} stands twice: {repeated[name]}" for name in sorted(repeated.keys() - TWICE)]
    wrong += [f"the class name {name} stands once: take it out of TWICE" for name in sorted(TWICE - repeated.keys())]
    for room, ceiling in CEILINGS.items():
        if counts[room] > ceiling:
            wrong.append(
                f"{room}: {counts[room]} names are one of {', '.join(sorted(SAY_NOTHING))}; at most {ceiling}"
            )
        elif counts[room] < ceiling:
            print(f"{room}: {counts[room]} names say nothing; its ceiling of {ceiling} may be lowered")
    print("\n".join(wrong) or f"{sum(counts.values())} names say nothing; {len(repeated)} class names stand twice")
    return bool(wrong)


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Return the path, relative to the root, and the syntax tree of each module of the product."""
    for room in PRODUCT:
        for path in sorted((ROOT / room).rglob("*.py")):
            yield str(path.relative_to(ROOT)), ast.parse(path.read_text())


def pages() -> Iterator[tuple[str, str]]:
    """Return the room and the text of each module and component of the pages; what is generated is left out."""
    for room in (room for room in CEILINGS if room.startswith("frontend/")):
        for path in sorted((ROOT / room).rglob("*")):
            is_ours = path.suffix in (".ts", ".svelte") and path.name != "schema.ts"
            if is_ours and not path.name.endswith(".test.ts"):
                yield room, path.read_text()


def names_of_page(text: str) -> Iterator[str]:
    """Return the names that TypeScript or Svelte declares: variables, functions and parameters."""
    text = _COMMENT.sub("", text)
    for declared in _DECLARED.finditer(text):
        yield next(filter(None, declared.groups()))
    for listed in (*_UNPACKED.finditer(text), *_PARAMETERS.finditer(text)):
        for part in listed[1].split(","):
            name = re.search(r"(\w+)\s*$", part.partition("=")[0].partition(":")[0])
            if name:
                yield name[1]


def name_of(node: ast.AST) -> str | None:
    """Return the name that a node gives to something; None if it gives none."""
    match node:
        case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
            return name
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return name
    return None


if __name__ == "__main__":
    sys.exit(main())
