"""Messages of a recording that were left out, because they cannot be used."""

from __future__ import annotations

from apexcal.documents.base import Document


class Omission(Document):
    """Messages of one topic that were left out for one reason.

    Attributes:
        topic: topic, folder or file, as the recording names it.
        code: the reason, for programs, for example ``cloud_empty``.
        count: how many were left out of ``total`` that were read.
        sentence: the same for people.
        example: what is wrong with the first of them, and where it stands.
    """

    topic: str
    code: str
    count: int
    total: int
    sentence: str
    example: str
