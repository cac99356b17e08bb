"""Damage as it happens and as somebody would plan it, from a seeded generator: the same seed, the same bytes."""

import random
import re

_LENGTHS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63 - 1, 2**63, 2**64 - 1)
_NUMBERS = (b"0", b"-1", b"1e309", b"nan", b"65536", b"4294967296", b"99999999999999999999", b"1.5", b"")


def flip_bits(rng, data, others):
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return out


def truncate(rng, data, others):
    return data[: rng.choice((rng.randrange(len(data)), len(data) - rng.randint(1, min(200, len(data)))))]


def cut_out(rng, data, others):
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.choice((1, 3, 16, 100, 1206, 4096)) :]


def repeat(rng, data, others):
    start = rng.randrange(len(data))
    block = data[start : start + rng.choice((1, 8, 64, 512, 4096))]
    return data[:start] + block * rng.choice((2, 3, 50)) + data[start:]


def overwrite(rng, data, others):
    """A block of the file, or of another of the same format, in the wrong place."""
    source = rng.choice((data, *others))
    size = rng.choice((2, 4, 16, 64, 400, 2000))
    start, place = rng.randrange(len(source)), rng.randrange(len(data))
    block = source[start : start + size]
    return data[:place] + block + data[place + len(block) :]


def splice(rng, data, others):
    """The beginning of one file and the end of another."""
    other = rng.choice((data, *others))
    return data[: rng.randint(1, len(data))] + other[rng.randrange(len(other)) :]


def set_length(rng, data, others):
    """What may be a size, a count or an offset gets a value at the edge of its type; headers and trailers first."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3))):
        width = rng.choice((1, 2, 4, 8))
        near = rng.choice((64, 512, len(out)))
        place = rng.randrange(min(near, len(out)))
        if rng.random() < 0.3:
            place = max(0, len(out) - 1 - place)
        value = rng.choice(_LENGTHS) % 2 ** (8 * width)
        out[place : place + width] = value.to_bytes(width, rng.choice(("little", "big")))
    return out


def set_number(rng, data, others):
    """A number that is written out as text."""
    found = [match.span() for match in re.finditer(rb"\d+", data)]
    if not found:
        return set_length(rng, data, others)
    start, end = rng.choice(found[: rng.choice((20, len(found)))])
    return data[:start] + rng.choice(_NUMBERS) + data[end:]


def swap_words(rng, data, others):
    """A name in the place of another."""
    found = [match.span() for match in re.finditer(rb"[A-Za-z_/]{3,}", data)]
    if len(found) < 2:
        return overwrite(rng, data, others)
    (a, b), (c, d) = rng.choice(found), rng.choice(found)
    return data[:a] + data[c:d] + data[b:]


def fill(rng, data, others):
    start = rng.randrange(len(data))
    end = min(len(data), start + rng.choice((4, 32, 256, 5000)))
    return data[:start] + bytes([rng.choice((0, 0xFF, rng.randrange(256)))]) * (end - start) + data[end:]


def point_elsewhere(rng, data, others):
    """What may be an offset, a page or a count gets the value of another: so things overlap, repeat, and go round."""
    width = rng.choice((2, 4, 4, 8))
    source, place = rng.randrange(len(data)), rng.randrange(len(data))
    number = data[source : source + width]
    return data[:place] + number + data[place + len(number) :]


def repeat_at_end(rng, data, others):
    """The end of the file, where many formats have their index, several times over."""
    size = rng.choice((50, 400, 4096))
    return data + data[-size:] * rng.choice((1, 10, 200))


MUTATIONS = (
    *(flip_bits, truncate, cut_out, repeat, overwrite, splice, set_length, set_length, set_number, swap_words, fill),
    *(point_elsewhere, point_elsewhere, repeat_at_end),
)


def mutate(data, others, seed):
    """One file damaged in one to three ways; ``others`` are whole files of the same format."""
    rng = random.Random(seed)
    out = bytes(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if out:
            out = bytes(rng.choice(MUTATIONS)(rng, out, others))
    return out
