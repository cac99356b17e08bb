"""Counter-based random numbers: draw n of a stream is a pure function of the stream's key and n.

So nothing depends on what ran before, on which worker, or in which order.
"""

import hashlib
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.solver.problem import FitProblem

_GOLDEN: Final = np.uint64(0x9E3779B97F4A7C15)
_MIX_1: Final = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2: Final = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S16, _S32, _S40, _S48 = np.uint64(16), np.uint64(32), np.uint64(40), np.uint64(48)
_LOW_16: Final = np.uint64(0xFFFF)
_TO_UNIT: Final = np.float32(2.0**-24)
_CENTRE: Final = np.int32(2 * 0xFFFF)
_TO_NORMAL: Final = np.float32(np.sqrt(3.0) / 65536.0)


def stream_key(problem: FitProblem, iteration: int, slot: int) -> np.uint64:
    """The key of one slot's stream, from (seed, model, camera, fold, iteration, slot) and nothing else."""
    text = "\x1f".join(
        str(part) for part in (problem.seed, problem.model, problem.camera, problem.fold, iteration, slot)
    )
    digest = hashlib.blake2b(text.encode(), digest_size=8, person=b"apexcal-slot").digest()
    return np.uint64(int.from_bytes(digest, "little"))


@njit(nogil=True, error_model="numpy", forceinline=True)
def draw(key: np.uint64, counter: np.uint64) -> np.uint64:
    """64 random bits (splitmix64's output function over key + counter; Steele, Lea and Flood 2014)."""
    bits = key + counter * _GOLDEN
    bits = (bits ^ (bits >> _S30)) * _MIX_1
    bits = (bits ^ (bits >> _S27)) * _MIX_2
    return bits ^ (bits >> _S31)


@njit(nogil=True, error_model="numpy", cache=True)
def fill_uniform(key: np.uint64, first: int, out: NDArray[np.float32]) -> None:
    """Fill out (n,) with uniform numbers in [0, 1), from draw number `first` on."""
    start = np.uint64(first)
    for i in range(out.shape[0]):
        out[i] = np.float32(np.int32(draw(key, start + np.uint64(i)) >> _S40)) * _TO_UNIT


@njit(nogil=True, error_model="numpy", cache=True)
def fill_normal(key: np.uint64, first: int, out: NDArray[np.float32]) -> None:
    """Fill out (4, n) with nearly normal numbers (mean 0, variance 1), column i from draw number `first` + i.

    The four 16-bit uniform numbers of a draw, summed with the signs of a Hadamard matrix's rows (Rader 1969): each is
    the sum of four uniform numbers (Irwin and Hall; tails that end at 3.5 sigma), and no two are correlated. No
    logarithm, no branch, and a quarter of the draws.
    """
    start = np.uint64(first)
    n = out.shape[1]
    plus, across, along, round_ = out[0], out[1], out[2], out[3]
    for i in range(n):
        bits = draw(key, start + np.uint64(i))
        a, b = np.int32(bits & _LOW_16), np.int32((bits >> _S16) & _LOW_16)
        c, d = np.int32((bits >> _S32) & _LOW_16), np.int32(bits >> _S48)
        ab, a_b, cd, c_d = a + b, a - b, c + d, c - d
        plus[i] = np.float32(ab + cd - _CENTRE) * _TO_NORMAL
        across[i] = np.float32(ab - cd) * _TO_NORMAL
        along[i] = np.float32(a_b + c_d) * _TO_NORMAL
        round_[i] = np.float32(a_b - c_d) * _TO_NORMAL
