"""Ingestion in a child process with limits, so that no uploaded file can take a worker down."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack, cast

from workers.readers.isolation.isolate import Isolation
from workers.readers.limits import Limits
from workers.readers.normalised.manifest import RecordingManifest
from workers.readers.progress import IngestProgress, OnProgress
from workers.readers.recording import ReadError
from workers.readers.supervise import TalksTooMuchError, supervise

_SPLIT: Final = "Split the recording, or ask whoever runs the service to raise the limit."
_ENDLESS: Final = (
    "The file may be damaged, or made to keep its reader busy. If it is a real recording, split it, or raise the "
    "limit."
)
# Code: what happened, and what to do.
_REFUSALS: Final = {
    "ingest_memory_limit": (
        "Reading {name} took more than the {memory} of memory allowed for it.",
        "A message in it may be damaged and claim a huge size. If it really is this large, ask whoever runs the "
        "service to raise the limit.",
    ),
    "ingest_cpu_limit": (
        "Reading {name} took more than the {limits.cpu_s} s of processor time allowed for it.",
        _SPLIT,
    ),
    "ingest_time_limit": (
        "Reading {name} took more than the {limits.wall_s:.0f} s allowed for a recording of its size.",
        _ENDLESS,
    ),
    "ingest_silent": ("Reading {name} got nowhere for {limits.silence_s:.0f} s.", _ENDLESS),
    "ingest_file_limit": ("A sensor of {name}, or a file packed in it, takes more than {file}.", _SPLIT),
    "ingest_output_limit": (
        "Reading {name} ({size}) would store more than a recording of its size can hold.",
        "Its content is packed far tighter than recorders pack, or is named again and again. If it is a real "
        "recording, upload it without compression, or ask whoever runs the service to raise the limit.",
    ),
    "ingest_disk_full": ("The disk was full while {name} was read.", "Make room, then try again."),
    "ingest_killed": (
        "The process that read {name} was killed, perhaps because the machine ran out of memory.",
        "Try again; if it happens again, split the recording or use a larger machine.",
    ),
    "ingest_crashed": (
        "The process that read {name} ended without a result ({how}).",
        "The file may be damaged in a way that is not known yet. The original is kept; please report it.",
    ),
}
_SIGNALS: Final[dict[int, str]] = {
    signal.SIGXFSZ: "ingest_file_limit",
    signal.SIGXCPU: "ingest_cpu_limit",
    signal.SIGKILL: "ingest_killed",
}
_LOOK_AT_DISK_S: Final = 1.0
_ROOT: Final = Path(__file__).parents[2]
# The child decodes strangers' bytes: it gets no password that the worker's environment may hold.
_ENVIRONMENT: Final = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME")


class Terms(TypedDict, total=False):
    """The terms under which a child is watched.

    Attributes:
        limits: what it may take.
        name: what its owner calls the recording, for messages; None: the name of the file.
        on_progress: called a few times a second while messages are read.
        must_stop: called a few times a second in any case. What one of them raises kills the child and comes out of
            the call.
    """

    limits: Limits | None
    name: str | None
    on_progress: OnProgress | None
    must_stop: Callable[[], None] | None


def ingest_limited(
    source: str | Path, out_dir: str | Path, request: Mapping[str, Any], **terms: Unpack[Terms]
) -> RecordingManifest:
    """Normalise a recording in a child process; see :func:`workers.readers.normalised.normalise.normalise`.

    The child dies with this process, and with the thread that calls this function. After any error ``out_dir`` is
    gone.

    Args:
        source: the recording, a file or a folder.
        out_dir: a folder that is not there yet, or is empty.
        request: ``lidar`` (topic), ``cameras`` (names, or names with topics), ``image_sizes`` (names with width and
            height) and ``options`` (the fields of :class:`ReadOptions`), each of them optional.
        terms: see :class:`Terms`.

    Raises:
        ReadError: the recording cannot be used, or ``request_invalid``, ``ingest_memory_limit``,
            ``ingest_cpu_limit``, ``ingest_time_limit``, ``ingest_silent``, ``ingest_file_limit``,
            ``ingest_output_limit``, ``ingest_disk_full``, ``ingest_crashed``, ``ingest_killed``.
        ValueError: ``out_dir`` holds something.
    """
    return RecordingManifest.model_validate(_limited([Path(source)], Path(out_dir), request, **terms)["manifest"])


def write_limited(
    sources: Sequence[Path], out_dir: Path, request: Mapping[str, Any], **terms: Unpack[Terms]
) -> dict[str, Any]:
    """Write one file in a child process, from files that it alone may read.

    Args:
        sources: the first is what is read; the others are named in the request.
        request: ``copy`` (see :func:`workers.readers.copying.copy_recording.copy_recording`) or ``view`` (see
            :func:`workers.readers.viewing.viewer_file.write_viewer_file`), which say what is returned.
        terms: see :class:`Terms`.

    Returns:
        ``file`` is a bare name in ``out_dir``.

    Raises:
        ReadError: the file cannot be written, or as :func:`ingest_limited` does.
        ValueError: ``out_dir`` holds something, or the child named no file in it.
    """
    answer: dict[str, Any] = _limited(sources, out_dir, request, **terms)["file"]
    if Path(str(answer["file"])).name != answer["file"] or not (out_dir / answer["file"]).is_file():
        raise ValueError(f"{answer['file']!r} is no file that was written")
    return answer


def _limited(
    sources: Sequence[Path], out: Path, request: Mapping[str, Any], **terms: Unpack[Terms]
) -> dict[str, Any]:
    """Return the last word of the child that does what is requested."""
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise ValueError(f"{out} is not empty")
    try:
        # What the child unpacks lies beside its results, and goes although the child may be killed.
        with tempfile.TemporaryDirectory(prefix="unpacking-", dir=out.parent) as scratch:
            return _Ingestion(sources, out, Path(scratch), terms).run(request)
    except BaseException as error:
        shutil.rmtree(out, ignore_errors=True)
        name = terms.get("name")
        if isinstance(error, ReadError) and name is not None:
            error.message = _renamed(error.message, sources[0].name, name)
        raise


def _renamed(message: str, source: str, name: str) -> str:
    """A message that begins with the source's name, with its owner's name instead.

    Elsewhere the same letters may be an ordinary word, or the name of a topic that its owner has to choose as it is.
    """
    return re.sub(rf"^{re.escape(source)}(?![\w/.-])", lambda _: name, message)


def isolation_here() -> Isolation:
    """Start a child to find out what isolates the children that read uploads on this machine."""
    command = [sys.executable, "-m", "workers.readers.isolation.isolate"]
    answer = subprocess.run(
        command, cwd=_ROOT, env=child_environment(), stdout=subprocess.PIPE, check=True, timeout=60
    )
    return Isolation(**json.loads(answer.stdout))


def child_environment() -> dict[str, str]:
    """Return what the children that decode strangers' bytes get of this environment."""
    # One thread: every further one of OpenBLAS reserves address space.
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
    return {key: os.environ[key] for key in _ENVIRONMENT if key in os.environ} | one_thread


def child_command(module: str, source: Path, out: Path, limits: Mapping[str, Any], *more: str) -> list[str]:
    """Return the command that starts a child; ``workers.readers.confine`` reads its last two options."""
    paths = (os.fspath(path.absolute()) for path in (source, out))
    return [sys.executable, "-m", module, *paths, *more, "--parent", str(os.getpid()), "--limits", json.dumps(limits)]


class _Ingestion:
    """One child, and what its starter watches."""

    def __init__(self, sources: Sequence[Path], out: Path, scratch: Path, terms: Terms) -> None:
        self._sources, self._out, self._scratch = sources, out, scratch
        self._limits = terms.get("limits") or Limits()
        self._name = terms.get("name") or sources[0].name
        self._on_progress, self._must_stop = terms.get("on_progress"), terms.get("must_stop")
        self._size = sum(map(_bytes_of, sources))
        self._last: dict[str, Any] = {}
        self._began = self._heard = time.monotonic()
        self._disk_due = 0.0

    def run(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Start the child and follow it to its end; return its last word."""
        environment = child_environment() | {"TMPDIR": str(self._scratch.resolve())}
        limits = {name: getattr(self._limits, name) for name in ("memory_bytes", "cpu_s", "file_bytes")}
        limits |= {
            "output_bytes": self._limits.output_bytes(self._size, video=False),
            "video_output_bytes": self._limits.output_bytes(self._size, video=True),
            "reserve_bytes": self._limits.reserve_bytes,
        }
        more = (word for path in self._sources[1:] for word in ("--also", os.fspath(path.absolute())))
        words = (*more, "--request", json.dumps(dict(request)))
        command = child_command("workers.readers", self._sources[0], self._out, limits, *words)
        try:
            ended = supervise(command, folder=_ROOT, environment=environment, take=self._take, look=self._look)
        except TalksTooMuchError as error:
            raise self._refused("ingest_crashed", "it printed without end") from error
        if "error" not in self._last:
            self._look_at_disk()  # a fast disk takes gigabytes between two looks
        if ended.code == 0 and ("manifest" in self._last or "file" in self._last):
            return self._last
        raised = self._explain(ended.code, self._last.get("error"), ended.complaint)
        if ended.complaint:
            raised.add_note(f"The reading process said:\n{ended.complaint}")
        raise raised

    def _take(self, line: bytes) -> None:
        """A line of the child: progress, a sign of life, or its last word."""
        try:
            message: Any = json.loads(line) if line.startswith(b"{") else None
        except ValueError:
            return
        if not isinstance(message, dict):  # what a library has to say
            return
        self._heard = time.monotonic()
        spoken = cast("dict[str, Any]", message)
        if "progress" in spoken:
            if self._on_progress is not None:
                self._on_progress(IngestProgress(**spoken["progress"]))
        elif "beat" not in spoken:
            self._last = spoken

    def _look(self) -> None:
        """Raise where the child must end before it ends itself."""
        if self._must_stop is not None:
            self._must_stop()
        now = time.monotonic()
        if now - self._began > self._limits.wall_s:
            raise self._refused("ingest_time_limit")
        if now - self._heard > self._limits.silence_s:
            raise self._refused("ingest_silent")
        if now >= self._disk_due:
            self._look_at_disk()
            # Ten thousand files in a folder took 0.07 s to look at.
            self._disk_due = time.monotonic() + _LOOK_AT_DISK_S + 20 * (time.monotonic() - now)

    def _look_at_disk(self) -> None:
        """The child counts what it writes; this check also holds where an upload has taken the child over."""
        if _stored(self._out) + _stored(self._scratch) > self._limits.output_bytes(self._size, video=True):
            raise self._refused("ingest_output_limit")
        if shutil.disk_usage(self._out).free < self._limits.reserve_bytes:
            raise self._refused("ingest_disk_full")

    def _explain(self, code: int, error: Mapping[str, Any] | None, complaint: str) -> ReadError:
        if error and error["message"]:
            return ReadError(error["code"], error["message"], error["hint"], error["fields"])
        if any(word in complaint for word in ("MemoryError", "std::bad_alloc", "Cannot allocate memory")):
            return self._refused("ingest_memory_limit")
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return self._refused(error["code"] if error else _SIGNALS.get(-code, "ingest_crashed"), how)

    def _refused(self, code: str, how: str = "") -> ReadError:
        code = code if code in _REFUSALS else "ingest_crashed"
        message, hint = _REFUSALS[code]
        sizes = {"memory": self._limits.memory_bytes, "file": self._limits.file_bytes, "size": self._size}
        words = {name: _size(count) for name, count in sizes.items()}
        return ReadError(code, message.format(name=self._name, how=how, limits=self._limits, **words), hint)


def _bytes_of(source: Path) -> int:
    """Size of a file, or of all files in a folder."""
    if not source.is_dir():
        return source.stat().st_size if source.exists() else 0
    return sum(file.lstat().st_size for file in source.rglob("*") if not file.is_dir())


def _stored(folder: Path) -> int:
    """Bytes that a folder takes on the disk; files come and go meanwhile."""
    count = 0
    for parent, _, files in os.walk(folder):
        for name in files:
            try:
                count += (Path(parent) / name).lstat().st_blocks * 512
            except FileNotFoundError:
                continue
    return count


def _size(count: int) -> str:
    if count < 1024**2:
        return f"{max(1, count // 1024)} kB"
    return f"{count / 1024**3:.1f} GB" if count >= 1024**3 else f"{count / 1024**2:.0f} MB"
