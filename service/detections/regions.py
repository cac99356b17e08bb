"""The region of interest as a request carries it: a tree of inequalities, checked node by node.

The workers compile the same document (``workers/vertices/region.py``); a contract test holds both to one language.
Text is never evaluated: a leaf is a quantity, perhaps divided by another, an operator and a number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    Tag,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

MAX_DEPTH = 16
MAX_NODES = 256

Quantity = Literal["x", "y", "z", "range", "azimuth_deg", "elevation_deg"]
Operator = Literal["<", "<=", ">", ">="]
Document = dict[str, Any]


class _Node(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Leaf(_Node):
    """One inequality: ``quantity [/ divided_by] op value``, in metres, degrees or as a ratio."""

    quantity: Quantity
    divided_by: Quantity | None = None
    op: Operator
    value: FiniteFloat


class And(_Node):
    """Holds where all of its nodes hold."""

    all_of: Annotated[list[Node], Field(min_length=1, alias="and")]


class Or(_Node):
    """Holds where one of its nodes holds."""

    any_of: Annotated[list[Node], Field(min_length=1, alias="or")]


def _kind(node: object) -> str:
    if isinstance(node, Mapping):
        for name in ("and", "or"):
            if name in node:
                return name
    return "leaf"


Node = Annotated[
    Annotated[And, Tag("and")] | Annotated[Or, Tag("or")] | Annotated[Leaf, Tag("leaf")], Discriminator(_kind)
]
And.model_rebuild()
Or.model_rebuild()
_TREE: TypeAdapter[And | Or | Leaf] = TypeAdapter(Node)


def check_region(document: Document) -> Document:
    """The document in its canonical form (no empty members), for a request's validation.

    Raises:
        PydanticCustomError: ``region_invalid`` or ``region_too_large``, naming the path of the first bad node.
    """
    _check_size(document)
    try:
        tree = _TREE.validate_python(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise PydanticCustomError(
            "region_invalid",
            "region node {path}: {what}",
            {"path": _path(first["loc"]), "what": first["msg"]},
        ) from None
    return _document(tree)


def _document(node: And | Or | Leaf) -> Document:
    # Not model_dump: pydantic tries every member of the union again on each of the levels.
    if isinstance(node, And):
        return {"and": [_document(child) for child in node.all_of]}
    if isinstance(node, Or):
        return {"or": [_document(child) for child in node.any_of]}
    return node.model_dump(exclude_none=True)


def _check_size(document: Document) -> None:
    """Refuse what is too deep or too large before anything recursive looks at it."""
    nodes = 0
    waiting: list[tuple[object, str, int]] = [(document, "$", 1)]
    while waiting:
        node, path, depth = waiting.pop()
        nodes += 1
        if depth > MAX_DEPTH or nodes > MAX_NODES:
            limit = f"deeper than {MAX_DEPTH} levels" if depth > MAX_DEPTH else f"larger than {MAX_NODES} nodes"
            raise PydanticCustomError(
                "region_too_large",
                "region node {path}: the tree is {limit}; merge nested and / or nodes",
                {"path": path, "limit": limit},
            )
        for name in ("and", "or"):
            children = node.get(name) if isinstance(node, Mapping) else None
            if isinstance(children, Sequence) and not isinstance(children, str):
                waiting += [(child, f"{path}.{name}[{index}]", depth + 1) for index, child in enumerate(children)]


def _path(location: tuple[str | int, ...]) -> str:
    """``$.and[1].op`` from pydantic's location, which also names the member that was chosen of each union."""
    path = "$"
    chosen = True  # pydantic puts the tag of a union before the field
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
            chosen = True
        elif chosen:
            chosen = False
        else:
            path += f".{part}"
    return path


Region = Annotated[
    Document,
    AfterValidator(check_region),
    WithJsonSchema(
        {
            "type": "object",
            "description": (
                'A tree: {"and": [nodes]}, {"or": [nodes]}, or a leaf {"quantity", "divided_by", "op", "value"}. '
                f"Quantities: x, y, z, range (metres, LiDAR frame), azimuth_deg, elevation_deg; at most {MAX_DEPTH} "
                f"levels and {MAX_NODES} nodes."
            ),
            "examples": [
                {
                    "and": [
                        {"quantity": "x", "op": ">", "value": 0},
                        {"quantity": "range", "op": "<", "value": 9},
                        {"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2},
                    ]
                }
            ],
        }
    ),
]
