"""Errors of a store: missing, full, away."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator
from contextlib import contextmanager

from obstore.exceptions import BaseError

log = logging.getLogger(__name__)

# Words of the operating system: obstore passes them on as text only.
_FULL = ("No space left on device", "Disk quota exceeded")
# A range behind the end of an object, as S3 and as a folder say it: what is asked for is as lost as a whole object.
_CUT = ("416 Range Not Satisfiable", "Requested range was invalid")


# The key of what its fleet's retention removed while the recording's rows stayed. No object has it.
EXPIRED = "expired"


class MissingBlobError(Exception):
    """The store does not hold these bytes, although a row says so: somebody removed or cut the object.

    Or its fleet's retention removed it.
    """

    code = "blob_missing"
    message = "The store no longer holds bytes of this recording that it held once."
    hint = "The operator should look for object {key} and restore it from a backup; else upload the recording again."

    def __init__(self, key: str) -> None:
        super().__init__(f"the blob store does not hold object {key!r} whole")
        self.key = key
        self.hint = type(self).hint.format(key=key)
        if key == EXPIRED:
            self.code = "retention_ended"
            self.message = "This part of the recording was removed at the end of its retention."
            self.hint = "Pairs, results and publications are still there. To mark or detect again, record again."


class ReservationEndedError(Exception):
    """A reserved key was condemned before its object was declared to be in use, so the object may be gone."""

    def __init__(self, key: str) -> None:
        super().__init__(f"the reservation of {key!r} has ended")
        self.key = key


class StoreUnavailableError(ConnectionError):
    """The store does not answer in time, refuses, or has no such bucket. Trying again later may help."""

    def __init__(self) -> None:
        super().__init__(errno.EHOSTUNREACH, "the blob store does not answer as it should")


class StoreFullError(OSError):
    """The store has no room for the object, and nothing of it is left there.

    ``free`` is how many bytes it has free, where that is known.
    """

    def __init__(self, free: int | None = None) -> None:
        super().__init__(errno.ENOSPC, "the blob store is full")
        self.free = free


@contextmanager
def translated(key: str, *, writing: bool = False) -> Iterator[None]:
    """Raise one of this file's errors for whatever obstore raises in the block."""
    try:
        yield
    except (BaseError, OSError) as error:
        message = str(error)
        if any(words in message for words in _FULL):
            raise StoreFullError from error
        gone = isinstance(error, FileNotFoundError) or any(words in message for words in _CUT)
        if gone and not writing and "NoSuchBucket" not in message:
            raise MissingBlobError(key) from None
        log.warning("the blob store failed on %s: %s", key, message.partition("\n\nDebug source")[0])
        raise StoreUnavailableError from error
