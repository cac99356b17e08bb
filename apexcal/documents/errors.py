"""The error of the documents, with a hint."""

from __future__ import annotations

import copyreg
from collections.abc import Iterable
from typing import Any, TypeVar

Choice = TypeVar("Choice", bound=str)


class DocumentError(ValueError):
    """A document that cannot be used.

    ``code`` is stable and made for programs, ``message`` says what is wrong and where, ``hint`` what to do.
    ``fields`` are what a program can act on besides, such as the names that are known.
    """

    def __init__(self, code: str, message: str, hint: str = "", **fields: Any) -> None:
        super().__init__(f"{message} {hint}".strip())
        self.code = code
        self.message = message
        self.hint = hint
        self.fields = fields

    def __reduce__(self) -> tuple[Any, ...]:
        """An error's own would call the constructor with the message alone."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # pyright: ignore[reportAttributeAccessIssue]


def chosen(name: object, choices: Iterable[Choice], what: str) -> Choice:
    """Return the one of the choices that a name is. Raises DocumentError ``unknown_`` and ``what``, naming them."""
    names = tuple(choices)
    if name in names:
        return names[names.index(name)]  # type: ignore[arg-type]
    noun = what.replace("_", " ")
    hint = f"The {noun}s are {', '.join(names)}."
    raise DocumentError(f"unknown_{what}", f"There is no {noun} {name!r}.", hint, **{f"{what}s": list(names)})


class InputError(DocumentError):
    """Input that cannot be worked on."""


class GeometryError(InputError):
    """A rotation, a transform or a camera model that is not one."""
