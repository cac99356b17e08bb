"""The command: ``python -m workers.simulation --out DIR`` writes a recording with its ground truth."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict

from workers.simulation.options import options_of, parser
from workers.simulation.simulate import OnProgress, simulate

_PROGRESS_EVERY_S = 0.2


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, simulate, say what was written. Returns the exit code: 0 done, 2 refused."""
    command = parser()
    words = command.parse_args(arguments)
    began = time.perf_counter()
    try:
        options = options_of(words)
        files = simulate(options, words.out, _reporter(words.progress_json))
    except FileExistsError as error:
        return _refuse(command.prog, f"{error}. Choose another folder with --out, or remove it.", words.json)
    except ValueError as error:
        return _refuse(command.prog, str(error), words.json)
    except OSError as error:
        sentence = f"cannot write {error.filename}: {(error.strerror or '').lower()}."
        return _refuse(command.prog, sentence, words.json)
    took_s = round(time.perf_counter() - began, 3)
    if words.json or words.progress_json:
        summary = {**asdict(files), "format": options.format, "seconds": options.seconds, "took_s": took_s}
        print(json.dumps(summary, default=str))
    else:
        print(
            f"{files.recording}: {files.sweeps} sweeps and {files.frames} frames, "
            f"{files.recording_bytes / 1e6:.0f} MB, in {took_s} s.\n"
            f"The truth is in {files.truth}, the rig's description in {files.rig}."
        )
    return 0


def _reporter(as_json: bool) -> OnProgress | None:
    """Progress as JSON lines on standard output, or as one rewritten line on a terminal's standard error."""
    if not as_json and not sys.stderr.isatty():
        return None
    last = 0.0

    def report(stage: str, done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if done < total and now - last < _PROGRESS_EVERY_S:
            return
        last = now
        if as_json:
            print(json.dumps({"stage": stage, "done": done, "total": total}), flush=True)
        else:
            end = "\n" if done == total else ""
            print(f"\r{stage}: {done} of {total}", end=end, file=sys.stderr, flush=True)

    return report


def _refuse(command: str, sentence: str, as_json: bool) -> int:
    print(
        json.dumps({"error": {"message": sentence}}) if as_json else f"{command}: error: {sentence}", file=sys.stderr
    )
    return 2


if __name__ == "__main__":
    sys.exit(main())
