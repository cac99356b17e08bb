"""Errors between client and service, each with a sentence and a hint. As `http_rules`, for Python 3.8."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class ClientError(Exception):
    """Base of everything that the client raises on purpose. ``hint`` says what to do, and may be empty."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint

    @property
    def sentence(self) -> str:
        """What is wrong and what to do, as one or two sentences."""
        return " ".join(as_sentence(part) for part in (str(self), self.hint) if part)


class InputError(ClientError):
    """What the caller gave can be neither read nor sent: a file, an inequality, a number."""


class ApiError(ClientError):
    """The service refused: an RFC 9457 problem document. ``code`` is stable, ``fields`` is the whole document."""

    def __init__(self, status: int, fields: Mapping[str, Any]) -> None:
        self.status = status
        self.fields = dict(fields)
        self.code = str(fields.get("code") or "unknown")
        self.detail = str(fields.get("detail") or fields.get("title") or f"the service answered {status}")
        super().__init__(self.detail, str(fields.get("hint") or ""))

    @property
    def is_about_the_input(self) -> bool:
        """Whether the values of the request are wrong by themselves, whatever the service holds."""
        return self.code in (
            *("invalid_request", "invalid_options"),
            *("unknown_detector", "unknown_model", "unknown_format"),
        )

    @property
    def refused_fields(self) -> list[str]:
        """``field: what is wrong`` for each field of a body that the service could not take; empty for others."""
        errors = self.fields.get("errors")
        named = [error for error in errors if isinstance(error, dict)] if isinstance(errors, list) else []
        return [f"{error.get('field', '?')}: {error.get('message', 'is not valid')}" for error in named]


class UnreachableError(ClientError):
    """The service did not answer, also not after trying again."""


class ForeignAnswerError(ClientError):
    """Another program than the service answered, or the answer was damaged on its way."""

    def __init__(self, url: object, what: str) -> None:
        super().__init__(
            f"{url} {what}",
            "Is this the address of an apexcal service, its prefix too, and does a proxy or the sign-in page of a "
            "network answer in its place?",
        )


class TokenError(ClientError):
    """Text that can be no token; ``origin`` says where it stands, never what it is."""

    def __init__(self, origin: str) -> None:
        super().__init__(
            f"{origin} is no token: a token has only ASCII letters, digits and signs, and no spaces",
            "Copy it again as it was shown; it begins with apx_.",
        )


def as_sentence(text: str) -> str:
    """The text with the full stop that it may lack."""
    text = text.strip()
    return text if text.endswith((".", "!", "?", ":")) else text + "."
