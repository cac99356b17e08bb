"""Secrets: 256 random bits each, shown once, kept as SHA-256 only and found by it."""

from __future__ import annotations

import hashlib
import secrets

TOKEN_PREFIX = "apx_"


def new_secret(prefix: str = "") -> str:
    """A fresh secret in letters that fit into a header and a URL."""
    return prefix + secrets.token_urlsafe(32)


def secret_hash(secret: str) -> str:
    """What is stored of a secret. It has 256 random bits, so a plain hash cannot be searched."""
    return hashlib.sha256(secret.encode()).hexdigest()
