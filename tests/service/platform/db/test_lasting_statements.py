"""Aliases that statements of a process keep are whole before threads build and compile with them."""

import importlib
import pkgutil
from typing import Any

from sqlalchemy.orm import QueryableAttribute, aliased
from sqlalchemy.orm.util import AliasedClass

import service
from service.platform.db.base import lasting_alias
from service.platform.db.detections import Vertex


def is_complete(alias: Any) -> bool:
    """Whether all columns of an alias are looked up: an attribute keeps its column in a slot, empty until then."""
    slot = vars(QueryableAttribute)["expression"]
    attributes = [vars(alias).get(column.key) for column in alias._aliased_insp.mapper.column_attrs]
    try:
        return all(attribute is not None and slot.__get__(attribute) is not None for attribute in attributes)
    except AttributeError:
        return False


def test_aliases_that_a_module_keeps_are_complete():
    names = [module.name for module in pkgutil.walk_packages(service.__path__, "service.")]
    modules = [importlib.import_module(name) for name in names if "migrations" not in name and "__main__" not in name]
    aliases = [one for module in modules for one in vars(module).items() if isinstance(one[1], AliasedClass)]
    assert len(aliases) >= 10
    assert [name for name, alias in aliases if not is_complete(alias)] == []
    by_hand = aliased(Vertex)
    assert is_complete(lasting_alias(Vertex)) and not is_complete(by_hand)
    assert by_hand.rank is not None and not is_complete(by_hand)
