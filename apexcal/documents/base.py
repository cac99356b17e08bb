"""The common ground of all request and answer bodies."""

from __future__ import annotations

import json
import math
import unicodedata
from collections.abc import Mapping
from typing import Annotated, Any, Generic, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

T = TypeVar("T")

# Control, format (directions, zero widths), surrogate and private characters; separators of lines and paragraphs.
_UNSEEN = frozenset(("Cc", "Cf", "Cs", "Co", "Zl", "Zp"))
# Between letters they choose their form: Persian, the languages of India and emoji need them.
_JOINERS = frozenset("\u200c\u200d")
# Letters by their category that show nothing: combining joiner, Hangul fillers, Braille blank.
_BLANK = frozenset("\u034f\u115f\u1160\u2800\u3164\uffa0")


def _composed(value: Any) -> Any:
    # One spelling of each letter, or two names that look the same would be two.
    return unicodedata.normalize("NFC", value) if isinstance(value, str) else value


def legible_text(text: str) -> str:
    """The text, where it can be told from another by looking. Raises ValueError."""
    for letter in text:
        if unicodedata.category(letter) in _UNSEEN and letter not in _JOINERS:
            raise ValueError(
                f"holds U+{ord(letter):04X}; line breaks, control characters, and characters that cannot be seen or "
                "change the direction of text are not allowed"
            )
    if all(letter in _BLANK or letter in _JOINERS or letter.isspace() for letter in text):
        raise ValueError("holds nothing that can be seen")
    return text


def first_fault(error: ValidationError) -> tuple[str, str]:
    """Return where the first thing that is wrong stands, steps joined by dots, and what is wrong with it."""
    first = error.errors(include_url=False)[0]
    return ".".join(map(str, first["loc"])), first["msg"].removeprefix("Value error, ")


def visible(text: str, keep: str = "") -> str:
    """The text with everything that cannot be seen spelled as in JSON, but for the letters to ``keep``."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() or letter in keep else json.dumps(letter)[1:-1] for letter in text)


Name = Annotated[
    str,
    BeforeValidator(_composed),
    StringConstraints(strip_whitespace=True, min_length=1, max_length=200),
    AfterValidator(legible_text),
]
# Letter by letter as the recording has it.
Topic = Annotated[str, StringConstraints(min_length=1, max_length=300), AfterValidator(legible_text)]
# What is only looked for: a NUL is in no stored text, and PostgreSQL refuses it.
Sought = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^\x00]*$")]
# Pixels, metres, radians, degrees and coefficients are all far below; a square of more may be infinite.
Magnitude = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]


def check_texts(document: Any) -> None:
    """Raises ValueError for a text or key, however deep, that no database keeps: with NUL, or half a surrogate pair.

    JSON can spell both (``\\u0000``, ``\\ud800``).
    """
    left = [document]
    while left:
        item = left.pop()
        if isinstance(item, str):
            if not item.isascii() and any("\ud800" <= letter <= "\udfff" for letter in item):
                raise ValueError("holds half of a surrogate pair, which is no character")
            if "\0" in item:
                raise ValueError("holds U+0000, a control character that no text has")
        elif isinstance(item, Mapping):
            left.extend(item)
            left.extend(item.values())
        elif isinstance(item, list):
            left.extend(item)


def not_finite(document: Any, at: str = "") -> str | None:
    """Return the path, joined by dots, of a number in a document that JSON cannot hold; None without one."""
    if isinstance(document, float):
        return None if math.isfinite(document) else at
    steps = document.items() if isinstance(document, Mapping) else ()
    steps = enumerate(document) if isinstance(document, list | tuple) else steps
    inside = (not_finite(value, f"{at}.{step}" if at else str(step)) for step, value in steps)
    return next((where for where in inside if where is not None), None)


class Received(BaseModel):
    """A request's body: unknown fields are refused, so that a misspelt one is not silently ignored."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _is_text(cls, body: Any) -> Any:
        check_texts(body)
        return body


class Sent(BaseModel):
    """An answer's body, read from a row's attributes where it is given one."""

    # Built with the first answer: for all at once that takes a tenth of the start.
    model_config = ConfigDict(from_attributes=True, defer_build=True)

    @classmethod
    def of(cls, row: object, **others: Any) -> Self:
        """The view of a row: its attributes by the members' names, and ``others`` that it lacks or has otherwise."""
        return cls(**{name: getattr(row, name) for name in cls.model_fields if name not in others}, **others)


class Page(BaseModel, Generic[T]):
    """One page; ``next`` is given as ``after`` to get the following one, and is null on the last."""

    model_config = ConfigDict(defer_build=True)

    items: list[T]
    next: str | None = None


class Document(BaseModel):
    """A document that is kept as JSON, with finite numbers only.

    Of another version it may have further members, which stay.
    """

    model_config = ConfigDict(extra="allow", allow_inf_nan=False, defer_build=True)


def _as_stored(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
    return handler(value) if info.mode == "json" else value


Stored = Annotated[T, WrapValidator(_as_stored), PlainSerializer(lambda value: value)]
"""A row's JSON: the service hands it out as it lies in the database, whatever version wrote it; who reads an answer
gets it as its type."""


def stored(document: Any) -> Any:
    """A row's JSON where an answer has a :data:`Stored` member; it is not looked at."""
    return document
