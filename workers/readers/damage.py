"""Turns what libraries raise on damaged files into answers that the owner understands."""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator
from contextlib import contextmanager

from workers.readers.bounded import ExpandsError
from workers.readers.recording import ReadError

# What decoding code raises when records contradict each other; libraries' own classes are named by their users.
_CONTRADICTIONS = (
    AssertionError,
    AttributeError,
    EOFError,
    IndexError,
    KeyError,
    OverflowError,
    TypeError,
    ValueError,  # of which UnicodeDecodeError is one
    struct.error,
)


@contextmanager
def damage(name: str, what: str, hint: str, *kinds: type[Exception]) -> Generator[None]:
    """Turn exceptions of decoders into ``recording_damaged``.

    Args:
        name: the file.
        what: its format, with its article.
        hint: what its owner can do.
        kinds: the libraries' own exceptions.
    """
    try:
        yield
    except (*kinds, ExpandsError) as error:
        raise _damaged(name, what, hint, str(error).rstrip(".")) from error
    except _CONTRADICTIONS as error:
        # What Python says here is for programmers; the cause keeps it.
        raise _damaged(name, what, hint, "its records contradict each other, or hold impossible values") from error
    except MemoryError as error:  # libraries take the sizes that records claim at their word
        hint += " If its messages really are this large, let ingestions take more memory."
        raise _damaged(name, what, hint, "a record claims more than the memory that reading may take") from error
    except RuntimeError as error:  # lz4
        raise _damaged(name, what, hint, f"a compressed part does not decompress ({error})") from error
    except OSError as error:  # bz2 raises it without an errno; anything else is the disk's
        if error.errno is not None:
            raise
        raise _damaged(name, what, hint, f"a compressed part does not decompress ({error})") from error


def _damaged(name: str, what: str, hint: str, why: str) -> ReadError:
    return ReadError("recording_damaged", f"{name} is {what} but cannot be read: {why}.", hint)


@contextmanager
def on_error(close: Callable[[], object]) -> Generator[None]:
    """Close what was opened if the block fails: a file that is refused stays open for nobody."""
    try:
        yield
    except BaseException:
        close()
        raise
