"""Octave's `ga`, the nearest free relative of what the paper used: it hands us its populations through two pipes."""

import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Finish, Peer, PeerMissingError

_OCTAVE = shutil.which("octave-cli") or shutil.which("octave")

# Its fitness writes a population, a row an individual, and reads the losses.
_SCRIPT = """
pkg load ga
asks = fopen("{asks}", "w"); hears = fopen("{hears}", "r");
function losses = fitness(x, asks, hears)
  fwrite(asks, rows(x), "double"); fwrite(asks, x', "double"); fflush(asks);
  losses = fread(hears, rows(x), "double");
end
rand("twister", {seed}); randn("twister", {seed}); rande("twister", {seed});
n = {genes};
options = gaoptimset("PopulationSize", {population}, "Generations", {generations}, "Vectorized", "on", ...
                     "PopInitRange", [zeros(1, n); ones(1, n)]);
best = ga(@(x) fitness(x, asks, hears), n, [], [], [], [], zeros(1, n), ones(1, n), [], options);
fwrite(asks, 0, "double"); fwrite(asks, best, "double"); fflush(asks);
"""


def _run(contest: Contest) -> Finish:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        asks, hears, script = (Path(folder) / name for name in ("asks", "hears", "race.m"))
        os.mkfifo(asks)
        os.mkfifo(hears)
        script.write_text(
            _SCRIPT.format(
                asks=asks,
                hears=hears,
                seed=contest.seed % 2**31,
                genes=contest.genes,
                population=POPULATION,
                generations=GENERATIONS,
            )
        )
        command = [str(_OCTAVE), "--norc", "--quiet", str(script)]
        # What it says at its end is nothing about the race.
        octave = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with asks.open("rb") as questions, hears.open("wb") as answers:
            best, evaluations = _answer(contest, questions, answers)
        octave.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    elsewhere = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Finish(best, evaluations, elsewhere)


def _answer(contest: Contest, questions: BinaryIO, answers: BinaryIO) -> tuple[np.ndarray, int]:
    # Losses for every population that is asked about, until the best comes, which stands behind a 0.
    evaluations = 0
    while count := int(_numbers(questions, 1)[0]):
        losses = contest.losses(_numbers(questions, count * contest.genes).reshape(count, contest.genes))
        answers.write(losses.tobytes())
        answers.flush()
        evaluations += count
    return _numbers(questions, contest.genes), evaluations


def _numbers(source: BinaryIO, count: int) -> np.ndarray:
    data = source.read(8 * count)
    if len(data) < 8 * count:
        raise RuntimeError("octave ended before its ga did: is the package `ga` complete?")
    return np.frombuffer(data, dtype=np.float64)


def _has_ga() -> bool:
    return (
        bool(_OCTAVE)
        and not subprocess.run(
            [str(_OCTAVE), "--norc", "--quiet", "--eval", "pkg load ga"], capture_output=True, check=False
        ).returncode
    )


if _OCTAVE is None:
    raise PeerMissingError("there is no octave command")
if not _has_ga():
    raise PeerMissingError("octave is here without its package ga (Debian: octave-ga)")

PEERS = [Peer("Octave ga", "octave ga", "its defaults, vectorised, started anew", _run, slow=True)]
