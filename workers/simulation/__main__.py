"""The command: ``python -m workers.simulation --out DIR`` writes a recording with its ground truth."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence

from workers.simulation.options import parser, settings_of
from workers.simulation.simulate import OnProgress, Settings, Simulated, simulate

_PROGRESS_EVERY_S = 0.2


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, simulate, say what was written. Returns the exit code: 0 done, 2 refused."""
    options = parser().parse_args(arguments)
    began = time.perf_counter()
    try:
        settings = settings_of(options)
        written = simulate(settings, options.out, _reporter(options.progress_json))
    except FileExistsError as error:
        return _refuse(f"{error}. Choose another folder with --out, or remove it.", options.json)
    except ValueError as error:
        return _refuse(f"{error}.", options.json)
    except OSError as error:
        return _refuse(f"cannot write {error.filename}: {(error.strerror or '').lower()}.", options.json)
    summary = _summary(settings, written, time.perf_counter() - began)
    print(json.dumps(summary) if options.json or options.progress_json else _sentence(written, summary["took_s"]))
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


def _summary(settings: Settings, written: Simulated, took_s: float) -> dict[str, object]:
    return {
        "recording": str(written.recording),
        "format": settings.format,
        "truth": str(written.truth),
        "rig": str(written.rig),
        "region": str(written.region),
        "seconds": settings.seconds,
        "sweeps": written.sweeps,
        "frames": written.frames,
        "recording_bytes": written.recording_bytes,
        "took_s": round(took_s, 3),
    }


def _sentence(written: Simulated, took_s: object) -> str:
    return (
        f"{written.recording}: {written.sweeps} sweeps and {written.frames} frames, "
        f"{written.recording_bytes / 1e6:.0f} MB, in {took_s} s.\n"
        f"The truth is in {written.truth}, the rig's description in {written.rig}."
    )


def _refuse(sentence: str, as_json: bool) -> int:
    print(json.dumps({"error": {"message": sentence}}) if as_json else sentence, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
