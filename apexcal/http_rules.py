"""The rules of all requests, whichever library sends them. Like `pull_alone`, for Python 3.8 and its library alone.

An answer is httpx's, or anything else with ``status_code``, ``headers`` and ``content``.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import random
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from email.utils import parsedate_to_datetime
from typing import Any
from urllib.parse import SplitResult, urlsplit

from apexcal.errors import ApiError, ForeignAnswerError, InputError

PAUSES_S = (0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 8.0)
BUSY = (408, 429, 502, 503, 504)
# A longer wait is the caller's to decide.
LONGEST_WAIT_S = 30.0
# The export of a vehicle of 100 cameras has less than 1 MB.
LONGEST_ANSWER = 16 * 2**20


def split_address(url: str) -> SplitResult | None:
    """The parts of a service's address; None where it can be none."""
    with contextlib.suppress(ValueError):
        parts = urlsplit(url)
        if parts.scheme in ("http", "https") and parts.hostname and parts.port != 0:
            return parts
    return None


def is_token(text: str) -> bool:
    """Whether a header can carry it behind "Bearer ": visible ASCII."""
    return re.fullmatch(r"[!-~]+", text) is not None


def may_leave(parts: SplitResult) -> bool:
    """Whether a token may leave this machine. Raises InputError where it would, over http, without being told to.

    If not, no proxy is asked either: it would read over http what is meant for this machine alone.
    """
    if parts.scheme == "https" or os.environ.get("APEXCAL_INSECURE_HTTP", "") not in ("", "0"):
        return True
    if not re.fullmatch(r"localhost|::1|127\.\d+\.\d+\.\d+", parts.hostname or ""):
        raise InputError(
            f"a token for {parts.netloc} would go over http, where others on the way can read it",
            "Give an https address, or allow it in a network that you trust: APEXCAL_INSECURE_HTTP=1",
        )
    return False


def ask_again(
    ask: Callable[[], Any],
    losses: tuple[type[Exception], ...],
    pauses_s: Sequence[float],
    busy: Sequence[int] = BUSY,
) -> Any:
    """Ask until an answer arrives that is final. The last try answers, or raises, whatever it does.

    Args:
        ask: sends the request once.
        losses: the classes that it raises where no answer arrives.
        busy: statuses that are not final, unless they ask to wait longer than `LONGEST_WAIT_S`.
    """
    for pause_s in pauses_s:
        wait_s = 0.0
        with contextlib.suppress(*losses):
            answer = ask()
            wait_s = retry_after_s(answer.headers)
            if answer.status_code not in busy or wait_s > LONGEST_WAIT_S:
                return answer
        # Spread, so that a fleet does not come back at one moment.
        time.sleep(max(pause_s, wait_s) * random.uniform(1.0, 1.5))
    return ask()


def retry_after_s(headers: Any) -> float:
    """Seconds that the answer asks to wait: a number or a date (RFC 9110, 10.2.3); 0 where it asks for none."""
    after = headers.get("Retry-After") or ""
    try:
        seconds = float(after) if after.isdigit() else parsedate_to_datetime(after).timestamp() - time.time()
    except (ValueError, TypeError):  # TypeError until Python 3.9
        return 0.0
    return max(seconds, 0.0)


def read_whole(url: object, headers: Any, pieces: Iterable[bytes]) -> bytes:
    """The content of an answer. Raises ForeignAnswerError if it is longer than any of ours, or compressed."""
    content = bytearray()
    for piece in pieces:
        content += piece
        if len(content) > LONGEST_ANSWER or headers.get("Content-Encoding", "identity") != "identity":
            raise ForeignAnswerError(url, f"answered more than {LONGEST_ANSWER} bytes, or compressed ones")
    return bytes(content)


def refuse_redirect(url: object, answer: Any) -> None:
    """Raise ForeignAnswerError for a redirect. None is followed: the token is for one server."""
    if 300 <= answer.status_code < 400 and "Location" in answer.headers:
        raise ForeignAnswerError(url, f"leads on to {answer.headers['Location']}, which is not followed")


def problem_of(answer: Any, otherwise: Mapping[str, str]) -> ApiError:
    """The problem document of a refused request; ``otherwise`` where the answer is none (a proxy's page)."""
    fields: Any = None
    with contextlib.suppress(ValueError):
        fields = json.loads(answer.content)
    fields = dict(fields if isinstance(fields, dict) else otherwise)
    wait_s = retry_after_s(answer.headers)
    if wait_s:
        fields["hint"] = f"{fields.get('hint') or ''} Ask again in {wait_s:.0f} s.".strip()
    return ApiError(answer.status_code, fields)


def digest_field(sha256: bytes) -> str:
    """A SHA-256 as headers state it (RFC 9530)."""
    return f"sha-256=:{base64.b64encode(sha256).decode()}:"


def check_document(url: object, answer: Any, media_type: str) -> None:
    """Raise ForeignAnswerError unless it is a whole document of a media type that begins so, with its SHA-256."""
    headers = answer.headers if answer.status_code == 200 else {}
    if not headers.get("ETag") or not headers.get("Content-Type", "").startswith(media_type):
        raise ForeignAnswerError(url, f"answered what is no {media_type.rstrip('+')}")
    if headers.get("Repr-Digest") != digest_field(hashlib.sha256(answer.content).digest()):
        raise ForeignAnswerError(url, "answered bytes without their SHA-256 (Repr-Digest)")
