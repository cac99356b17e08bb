"""A long list in a JSON document, read one element at a time.

``json.loads`` holds the interpreter's lock until it is through, and 32 MiB of ``[{"":[]},...]`` become 1.2 GB of
objects. Here nothing larger than one element is parsed at once, and other threads run in between.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

# A pair with every member that one may have is 320 letters long; a set's notes, which are skipped, a few thousand.
_USUAL = 512
_LONGEST = 16 * 1024

_SPACE = re.compile(r"[ \t\n\r]*")


class NoDocumentError(ValueError):
    """The document is no JSON, or not of this form; the message says where."""


def elements_of(body: bytes, member: str) -> Iterator[Any]:
    """The elements of the list that is ``member`` of the JSON object ``body``. Other members are skipped.

    Raises:
        NoDocumentError: once what is wrong is reached.
    """
    reader = _Reader(body)
    seen = False
    missing = NoDocumentError(f'it has no list "{member}"')
    if not reader.passes("{"):
        raise missing
    while not reader.ends("}", first="{"):
        name = reader.value()
        if not isinstance(name, str):
            raise reader.error("a name that is no text")
        reader.expect(":")
        if name != member:
            reader.value()
            continue
        if seen:
            raise reader.error(f'a second "{member}"')
        seen = True
        if not reader.passes("["):
            raise missing
        while not reader.ends("]", first="["):
            yield reader.value()
    reader.end()
    if not seen:
        raise missing


class _Reader:
    def __init__(self, body: bytes) -> None:
        try:
            self._text = body.decode(json.detect_encoding(body))
        except UnicodeDecodeError as error:
            raise NoDocumentError(f"byte {error.start} is no text") from None
        self._at = 0
        self._last = ""
        self._decoder = json.JSONDecoder()

    def error(self, what: str) -> NoDocumentError:
        return NoDocumentError(f"{what} at letter {self._at}")

    def passes(self, sign: str) -> bool:
        """Pass over ``sign`` where it stands here."""
        if self._next() != sign:
            return False
        self._at += 1
        self._last = sign
        return True

    def expect(self, sign: str) -> None:
        """Pass over ``sign``, which must stand here."""
        if not self.passes(sign):
            raise self.error(f"no {sign}")

    def ends(self, sign: str, *, first: str) -> bool:
        """Pass over the end of a list or object, or over the comma before its next element."""
        if self.passes(sign):
            return True
        if self._last != first:
            self.expect(",")
        return False

    def value(self) -> Any:
        """The value that stands here, of :data:`_LONGEST` letters at most."""
        self._next()
        try:
            return self._decoded(_USUAL)
        except (ValueError, RecursionError):
            return self._decoded_or_refused()

    def _decoded(self, length: int) -> Any:
        value, length = self._decoder.raw_decode(self._text[self._at : self._at + length])
        self._at += length
        self._last = ""
        return value

    def _decoded_or_refused(self) -> Any:
        try:
            return self._decoded(_LONGEST)
        except json.JSONDecodeError as error:
            if len(self._text) - self._at > _LONGEST:
                raise self.error(f"a value that is wrong, or longer than {_LONGEST} letters,") from None
            self._at += error.pos
            raise self.error(error.msg.lower()) from None
        except (ValueError, RecursionError):  # a number of thousands of digits, thousands of brackets
            raise self.error("a value that is too long or too deep") from None

    def end(self) -> None:
        """Nothing follows."""
        if self._next():
            raise self.error("more than one document")

    def _next(self) -> str:
        found = _SPACE.match(self._text, self._at)
        self._at = found.end() if found else self._at
        return self._text[self._at : self._at + 1]
