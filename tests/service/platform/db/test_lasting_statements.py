"""Statements that a process keeps are the same whichever threads build and compile them first."""

import importlib
import json
import pkgutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from inspect import signature
from itertools import product
from typing import Any

from sqlalchemy.dialects.postgresql import psycopg
from sqlalchemy.orm import QueryableAttribute, aliased
from sqlalchemy.orm.util import AliasedClass
from sqlalchemy.sql.base import Executable

import service
from service.platform.db.base import lasting_alias
from service.platform.db.detections import Vertex

# What the parameters of functions that keep statements can be.
VALUES = {"bool": (False, True), "str": ("sqlite", "postgresql")}
THREADS = 6


def modules() -> Iterator[Any]:
    for module in pkgutil.walk_packages(service.__path__, "service."):
        if "migrations" not in module.name and not module.name.endswith("__main__"):
            yield importlib.import_module(module.name)


def builders() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every call of a function of the service that keeps a statement."""
    for module in modules():
        for name, function in vars(module).items():
            if not hasattr(function, "cache_info") or getattr(function, "__module__", "") != module.__name__:
                continue
            parameters = signature(function).parameters.values()
            if not all(parameter.annotation in VALUES for parameter in parameters):
                continue
            for values in product(*(VALUES[parameter.annotation] for parameter in parameters)):
                names = {parameter.name: value for parameter, value in zip(parameters, values, strict=True)}
                yield f"{module.__name__}.{name} {names}", partial(function, **names)


def compiled(threads: int) -> dict[str, list[str]]:
    """The texts of every statement that is kept, each built and compiled by so many threads at once."""
    texts: dict[str, list[str]] = {}
    dialect = psycopg.dialect()  # type: ignore[no-untyped-call]
    for name, build in [*builders()]:
        barrier, of_statement = threading.Barrier(threads), list[str]()

        def run(build=build, barrier=barrier, of_statement=of_statement) -> None:
            barrier.wait()
            statement = build()
            if isinstance(statement, Executable):
                of_statement.append(str(statement.compile(dialect=dialect)))

        running = [threading.Thread(target=run) for _ in range(threads)]
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()
        if of_statement:
            texts[name] = sorted(set(of_statement))
    return texts


def in_new_process(threads: int) -> dict[str, list[str]]:
    command = [sys.executable, "-W", "ignore", "-m", __name__, str(threads)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def test_threads_that_build_statements_at_once_build_the_same_ones():
    alone = in_new_process(1)
    assert len(alone) >= 20 and all(len(texts) == 1 for texts in alone.values())
    assert in_new_process(THREADS) == alone


def is_complete(alias: Any) -> bool:
    """Whether all columns of an alias are looked up: an attribute keeps its column in a slot, empty until then."""
    slot = vars(QueryableAttribute)["expression"]
    attributes = [vars(alias).get(column.key) for column in alias._aliased_insp.mapper.column_attrs]
    try:
        return all(attribute is not None and slot.__get__(attribute) is not None for attribute in attributes)
    except AttributeError:
        return False


def test_aliases_that_a_module_keeps_are_complete():
    aliases = {
        f"{module.__name__}.{name}": alias
        for module in modules()
        for name, alias in vars(module).items()
        if isinstance(alias, AliasedClass)
    }
    assert len(aliases) >= 10
    assert [name for name, alias in aliases.items() if not is_complete(alias)] == []
    by_hand = aliased(Vertex)
    assert is_complete(lasting_alias(Vertex)) and not is_complete(by_hand)
    assert by_hand.rank is not None and not is_complete(by_hand)


if __name__ == "__main__":
    sys.setswitchinterval(1e-6)
    print(json.dumps(compiled(int(sys.argv[1]))))
