"""Errors of an operator's command."""

from __future__ import annotations


class AdminError(Exception):
    """What is wrong, and ``hint``: what to do about it."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class WrongUsageError(AdminError):
    """An argument that could name nothing, whatever the service holds."""
