"""`python -m benchmarks.detection`: precision of the detectors on simulated walks, and their speed.

WALKS (default 6) walks of 60 s each through a field of 10 x 30 m for the plain case, half as many for each other:
distractors, variants, and boards that are held rolled, leaning or far from the body. SEED repeats a run;
THROUGHPUT_SECONDS (default 60) is the length of the recording that is timed.
Shares are of the sweeps in which two rings or more meet the board; errors are against the apex at the moment when the
sensor looked at it; pixels at a focal length of 400. Human-readable lines go to stderr, one line of JSON to stdout.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from benchmarks.detection.figures import figures, rounded
from benchmarks.detection.walks import SIZE, Case, Found, run
from benchmarks.throughput import measure
from workers.simulation.disturbances import Disturbances

_SECONDS = 60.0
_REFINED = {"refined": ("refined", SIZE)}
_PLAIN = Case(
    "plain",
    {
        "strict": ("strict", {}),
        "tolerant": ("tolerant", {}),
        **_REFINED,
        "refined_size_unknown": ("refined", {}),
        "refined_without_track": ("refined", {**SIZE, "track": 0}),
    },
)
_DISTRACTORS = (
    Case("head", _REFINED, Disturbances(head_above_m=0.1)),
    Case("second_person_beside", _REFINED, Disturbances(second_person="beside")),
    Case("second_person_behind", _REFINED, Disturbances(second_person="behind")),
    Case("pole", _REFINED, Disturbances(poles=6)),
)
_VARIANTS = (
    Case("range_noise_30mm", _REFINED, noise_m=0.030),
    Case("beam_3mrad", _REFINED, Disturbances(beam_mrad=3.0)),
    Case("four_rings", _REFINED, four_rings=True),
    Case("lost_and_speckle", _REFINED, Disturbances(dropout_share=0.02, speckle_share=0.002)),
)
_HELD = (
    *(Case(f"rolled_{deg:+.0f}", _REFINED, Disturbances(rolled_deg=deg)) for deg in (-15.0, -10.0, 10.0, 15.0)),
    *(Case(f"tilted_{deg:.0f}", _REFINED, Disturbances(tilted_deg=deg)) for deg in (8.0, 18.0)),
    *(Case(f"torso_{m * 100:.0f}cm", _REFINED, Disturbances(body_behind_m=m)) for m in (0.25, 0.45, 0.9)),
    Case("rolled_tilted", _REFINED, Disturbances(rolled_deg=12.0, tilted_deg=10.0, body_behind_m=0.3)),
)


def main() -> None:
    walks = int(os.environ.get("WALKS", "6"))
    seed = int(os.environ.get("SEED") or secrets.randbits(30))
    asked = [(_PLAIN, seed + number, _SECONDS) for number in range(walks)]
    for place, case in enumerate((*_DISTRACTORS, *_VARIANTS, *_HELD), start=1):
        asked += [(case, seed + 1000 * place + number, _SECONDS) for number in range(max(1, walks // 2))]
    parts: dict[tuple[str, str], list[Found]] = defaultdict(list)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for done, found in enumerate(pool.map(run, asked), start=1):
            print(f"\r{done} of {len(asked)} walks", end="", file=sys.stderr, flush=True)
            for part in found:
                parts[part.case, part.key].append(part)
    print(file=sys.stderr)
    results = {key: figures(found) for key, found in parts.items()}
    for (case, key), result in results.items():
        _say(case if key == "refined" and case != "plain" else key, result)
    answer: dict[str, Any] = {key: results["plain", key] for key in _PLAIN.detectors}
    answer["distractors"] = {case.name: results[case.name, "refined"] for case in _DISTRACTORS}
    answer["variants"] = {case.name: results[case.name, "refined"] for case in _VARIANTS}
    answer["held"] = {case.name: results[case.name, "refined"] for case in _HELD}
    answer |= {"walks": walks, "seconds_each": _SECONDS, "seed": seed}
    answer |= measure(float(os.environ.get("THROUGHPUT_SECONDS", "60")))
    print(json.dumps(rounded(answer)))


def _say(name: str, result: dict[str, Any]) -> None:
    for label, part in ((name, result), ("  fine", result.get("fine")), *_bands(result)):
        if part and "rms_deg" in part:
            print(
                f"{label:24s} share {part['accepted_share']:.3f}  elevation {part['rms_elevation_deg']:.4f}  azimuth "
                f"{part['rms_azimuth_deg']:.4f}  total {part['rms_deg']:.4f} deg ({part['rms_px']:.2f} px)  bias "
                f"{part['bias_deg']:+.4f}  gross {part['gross_share']:.4f}  covered "
                f"{part.get('coverage_2sigma', float('nan')):.3f}  normalised {part.get('normalised_rms', 0.0):.2f}",
                file=sys.stderr,
            )


def _bands(result: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [(f"  {band}", part) for band, part in result["by_range"].items()]


if __name__ == "__main__":
    main()
