"""In which order people judge vertices: any first part of it covers the whole recording evenly."""

from __future__ import annotations


def spread_order(count: int) -> list[int]:
    """The rank of each of ``count`` vertices in time order: van der Corput's sequence in base 2.

    Whoever stops marking early has then marked vertices from the whole walk, near and far, left and right.
    """
    bits = max(count - 1, 1).bit_length()
    reversed_bits = [int(f"{index:0{bits}b}"[::-1], 2) for index in range(count)]
    rank_of = {value: rank for rank, value in enumerate(sorted(reversed_bits))}
    return [rank_of[value] for value in reversed_bits]
