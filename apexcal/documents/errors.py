"""The error of the documents, with a hint."""

from __future__ import annotations

from typing import Any


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


class InputError(DocumentError):
    """Input that cannot be worked on."""


class GeometryError(InputError):
    """A rotation, a transform or a camera model that is not one."""
