"""Addresses at which clients reach the store themselves, where the operator wants that and the store can."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from fastapi import Request

from service.platform.db.clock import utc_now
from service.platform.settings import Settings
from service.platform.storage.store import Store


@dataclass(frozen=True)
class Presigner:
    """Signs for one answer; all its addresses end together, at ``expires_at``."""

    store: Store
    settings: Settings
    expires_at: datetime

    @classmethod
    def of(cls, request: Request) -> Presigner:
        """The one of this request's application."""
        settings: Settings = request.app.state.settings
        return cls(request.app.state.store, settings, utc_now() + timedelta(seconds=settings.presigned_s))

    @property
    def uploads(self) -> bool:
        """Whether parts go straight to the store."""
        return self.settings.uploads == "presigned" and self.store.signs

    @property
    def downloads(self) -> bool:
        """Whether frames and originals come straight from the store."""
        return self.settings.downloads == "presigned" and self.store.signs

    def upload(self, key: str) -> str:
        """Where this object is put."""
        return self.store.sign_put(key, self.settings.presigned_s)

    def download(self, key: str) -> str | None:
        """Where this object is read; None where it goes through the API."""
        return self.store.sign_get(key, self.settings.presigned_s) if self.downloads else None
