"""One calibration with held-out blocks through the farm, and its runs in bare processes, turn by turn."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.accuracy.rigs import draw_rig
from benchmarks.bare import Bare, assert_same_bits, runs_of
from benchmarks.farm.asking import Asker
from benchmarks.house import House, cpu_s
from service.platform.db.calibrations import CalibrationRun

_REQUEST: dict[str, Any] = {"models": ["brown_conrady"], "folds": 5}
_LOOK_S = 0.01


def beside_bare(house: House, folder: Path, rounds: int, seed: int) -> dict[str, Any]:
    """A `brown_conrady` calibration of 222 pairs in five folds, from the request to its end, over bare processes."""
    asker = Asker(house, "whole calibrations", draw_rig("brown_conrady", np.random.default_rng([seed, 0])))
    _, (first,) = asker.ask(**_REQUEST)
    bare = Bare(runs_of(house.database, CalibrationRun.calibration_id == first), folder)
    try:
        _bare_round(bare)
        assert_same_bits(house.database, bare.results())
        turns = [_turn(house, asker, bare, number) for number in range(rounds)]
    finally:
        bare.close()
    farm_s, bare_s, farm_cpu_s, bare_cpu_s = (median(column) for column in zip(*turns, strict=True))
    return {
        "ratio_to_bare_processes": median(farm / alone for farm, alone, *_ in turns),
        "ratio_by_cpu": farm_cpu_s / bare_cpu_s,
        "calibration_s": farm_s,
        "bare_s": bare_s,
        "same_bits": True,
    }


def _turn(house: House, asker: Asker, bare: Bare, number: int) -> tuple[float, float, float, float]:
    """Wall and processor seconds of the farm and of the bare processes; who is first changes with each round."""
    found: dict[str, tuple[float, float]] = {}
    for who in ("farm", "bare") if number % 2 else ("bare", "farm"):
        if who == "farm":
            used = sum(house.cpu_s().values())
            seconds, _ = asker.ask(**_REQUEST)
            found[who] = seconds, sum(house.cpu_s().values()) - used
        else:
            used = sum(map(cpu_s, bare.pids))
            seconds = _bare_round(bare)
            found[who] = seconds, sum(map(cpu_s, bare.pids)) - used
            bare.results()
    print(f"calibration {found['farm'][0]:6.2f} s, bare {found['bare'][0]:6.2f} s", file=sys.stderr)
    return found["farm"][0], found["bare"][0], found["farm"][1], found["bare"][1]


def _bare_round(bare: Bare) -> float:
    bare.begin()
    began = time.perf_counter()
    while not bare.is_done:
        time.sleep(_LOOK_S)
    return time.perf_counter() - began
