"""Messages of a recording that were left out, because they cannot be used."""

from __future__ import annotations

from apexcal.documents.base import Document


class Omission(Document):
    """Messages of one topic that were left out for one reason.

    ``topic`` is a topic, folder or file, as the recording names it. ``code`` is the reason, for programs, such as
    "cloud_empty". ``count`` were left out of ``total`` that were read. ``sentence`` says the same for people.
    ``example`` says what is wrong with the first of them, and where it stands.
    """

    topic: str
    code: str
    count: int
    total: int
    sentence: str
    example: str
