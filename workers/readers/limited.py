"""Ingestion in a child process with limits, so that no uploaded file can take a worker down."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final, cast

from workers.readers.normalised.manifest import Manifest
from workers.readers.progress import OnProgress, Progress
from workers.readers.recording import ReadError

_LINE_BYTES: Final = 64 * 1024 * 1024
_ROOT: Final = Path(__file__).parents[2]
# The child decodes strangers' bytes: it gets no password that the worker's environment may hold.
_ENVIRONMENT: Final = (
    "PATH",
    "LANG",
    "LC_ALL",
    "LD_LIBRARY_PATH",
    "VIRTUAL_ENV",
    "PYTHONPATH",
    "PYTHONHOME",
)


def ingest_limited(
    source: str | Path,
    out_dir: str | Path,
    request: Mapping[str, Any],
    *,
    memory_bytes: int = 3 * 1024**3,
    cpu_s: int = 3600,
    file_bytes: int = 64 * 1024**3,
    name: str | None = None,
    on_progress: OnProgress | None = None,
) -> Manifest:
    """Normalise a recording in a child process; see :func:`workers.readers.normalised.normalise.normalise`.

    The child dies with this process, and with the thread that calls this function. After any error ``out_dir`` is
    gone.

    Args:
        source: the recording, a file or a folder.
        out_dir: a folder that is not there yet, or is empty.
        request: ``lidar`` (topic), ``cameras`` (names, or names with topics), ``image_sizes`` (names with width and
            height) and ``options`` (the fields of :class:`ReadOptions`), each of them optional.
        memory_bytes: the child's address space; its libraries alone take about 0.4 GB of it.
        cpu_s: the child's processor seconds.
        file_bytes: the largest file that it may write.
        name: what its owner calls the recording, for messages; None: the name of ``source``.
        on_progress: called a few times a second; what it raises stops the child and comes out of here.

    Raises:
        ReadError: the recording cannot be used, or ``request_invalid``, ``ingest_memory_limit``,
            ``ingest_cpu_limit``, ``ingest_file_limit``, ``ingest_disk_full``, ``ingest_crashed``, ``ingest_killed``.
        ValueError: ``out_dir`` holds something.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        raise ValueError(f"{out} is not empty")
    command = [
        *(sys.executable, "-m", "workers.readers", os.fspath(Path(source).absolute()), os.fspath(out.absolute())),
        *("--request", json.dumps(dict(request)), "--parent", str(os.getpid())),
        *("--memory-bytes", str(memory_bytes), "--cpu-s", str(cpu_s), "--file-bytes", str(file_bytes)),
    ]
    limits = {"memory_bytes": memory_bytes, "cpu_s": cpu_s, "file_bytes": file_bytes}
    try:
        # What the child unpacks lies beside its results, and goes although the child may be killed.
        with tempfile.TemporaryDirectory(prefix="unpacking-", dir=out.parent) as scratch:
            return _run(command, scratch, name or Path(source).name, limits, on_progress)
    except ReadError as error:
        shutil.rmtree(out, ignore_errors=True)
        if name is not None:
            error.message = _renamed(error.message, Path(source).name, name)
        raise
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise


def _renamed(message: str, source: str, name: str) -> str:
    """A message that begins with the source's name, with its owner's name instead.

    Elsewhere the same letters may be an ordinary word, or the name of a topic that its owner has to choose as it is.
    """
    return re.sub(rf"^{re.escape(source)}(?![\w/.-])", lambda _: name, message)


def _run(
    command: list[str], scratch: str, name: str, limits: Mapping[str, int], on_progress: OnProgress | None
) -> Manifest:
    environment = {key: os.environ[key] for key in _ENVIRONMENT if key in os.environ}
    # One thread: every further one of OpenBLAS reserves address space.
    environment |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "TMPDIR": str(Path(scratch).resolve())}
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, cwd=_ROOT, env=environment
        )
        try:
            assert child.stdout is not None
            last = _follow(child.stdout, on_progress)
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(timeout=10)
        finally:
            if child.poll() is None:
                child.kill()
                child.wait()
            if child.stdout is not None:
                child.stdout.close()
        errors.seek(max(0, errors.seek(0, os.SEEK_END) - 4000))
        said = errors.read().decode(errors="replace")
    if child.returncode == 0 and "manifest" in last:
        return Manifest.from_json(last["manifest"])
    raise _failure(child.returncode, last.get("error"), name, limits, said)


def _follow(stdout: IO[bytes], on_progress: OnProgress | None) -> dict[str, Any]:
    """Pass progress on; the last line that is no progress, or nothing."""
    last: dict[str, Any] = {}
    while line := stdout.readline(_LINE_BYTES):
        try:
            said: Any = json.loads(line)
        except ValueError:  # a line cut short by the child's death, or what a library has to say
            continue
        if not isinstance(said, dict):
            continue
        spoken = cast("dict[str, Any]", said)
        if "progress" not in spoken:
            last = spoken
        elif on_progress is not None:
            on_progress(Progress(**spoken["progress"]))
    return last


def _failure(
    code: int, error: Mapping[str, Any] | None, name: str, limits: Mapping[str, int], stderr: str
) -> ReadError:
    raised = _explain(code, error, name, limits, stderr)
    if stderr:
        raised.add_note(f"The reading process said:\n{stderr}")
    return raised


def _explain(
    code: int, error: Mapping[str, Any] | None, name: str, limits: Mapping[str, int], stderr: str
) -> ReadError:
    kind = error["code"] if error else ""
    if error and error["message"]:
        return ReadError(kind, error["message"], error["hint"], error["fields"])
    if kind == "ingest_memory_limit" or "MemoryError" in stderr or "std::bad_alloc" in stderr:
        return ReadError(
            "ingest_memory_limit",
            f"Reading {name} took more than the {_size(limits['memory_bytes'])} of memory allowed for it.",
            "A message in it may be damaged and claim a huge size. If it really is this large, raise the limit.",
        )
    if kind == "ingest_file_limit" or code == -signal.SIGXFSZ:
        return ReadError(
            "ingest_file_limit",
            f"A sensor of {name}, or a file packed in it, takes more than the {_size(limits['file_bytes'])} allowed.",
            "Split the recording, or raise the limit.",
        )
    if kind == "ingest_disk_full":
        return ReadError(
            "ingest_disk_full", f"The disk was full while {name} was read.", "Make room, then try again."
        )
    if code == -signal.SIGXCPU:
        return ReadError(
            "ingest_cpu_limit",
            f"Reading {name} took more than the {limits['cpu_s']} s of processor time allowed for it.",
            "Split the recording, or raise the limit.",
        )
    if code == -signal.SIGKILL:
        return ReadError(
            "ingest_killed",
            f"The process that read {name} was killed, perhaps because the machine ran out of memory.",
            "Try again; if it happens again, split the recording or use a larger machine.",
        )
    how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return ReadError(
        "ingest_crashed",
        f"The process that read {name} ended without a result ({how}).",
        "The file may be damaged in a way that is not known yet. The original is kept; please report it.",
    )


def _size(count: int) -> str:
    return f"{count / 1024**3:.1f} GB" if count >= 1024**3 else f"{count / 1024**2:.0f} MB"
