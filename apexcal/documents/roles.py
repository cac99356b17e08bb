"""Roles, each bound to a fleet and each including the ones before it."""

from __future__ import annotations

from typing import Literal, get_args

Role = Literal["viewer", "annotator", "reviewer", "engineer", "admin"]

ROLES: tuple[Role, ...] = get_args(Role)


def rank(role: str) -> int:
    """Place of a role in the order; unknown ones are below every role."""
    return ROLES.index(role) if role in ROLES else -1


def least(role: Role, other: str | None) -> Role:
    """The lesser of two roles; None limits nothing."""
    if other is None or rank(other) >= rank(role):
        return role
    return ROLES[max(rank(other), 0)]
