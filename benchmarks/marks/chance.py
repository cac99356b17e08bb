"""Scenes without a board, or whose frames are of another recording, drawn as vertices and seeds and not rendered."""

from __future__ import annotations

from typing import Final

import numpy as np

from apexcal.geometry.rotations import rotation_from_vector
from workers.geometry.models import ModelName
from workers.marks.mount_search import SeedPairs, search_mounts
from workers.marks.sights import Floats, Lens

_SIZE: Final = (1920, 1080)


def offers_mount(seed: int) -> bool:
    """Whether the machine takes a mount for one of these."""
    random = np.random.default_rng([seed, 41])
    count = int(random.uniform(8, 65))
    points = _walk(random, count) @ rotation_from_vector(random.normal(0.0, 2.0, 3)).T
    seeds = _seeds(random, count)
    sides = random.uniform() < 0.5
    owner = np.arange(count)
    if sides:
        aside = np.array([*(random.uniform(0.3, 0.6) * random.normal(0.0, 1.0, 2)), -0.5])
        points = np.concatenate([points, points + aside, points - aside * (1.0, 1.0, -1.0)])
        seeds = np.concatenate([seeds, seeds + np.array((-60.0, 60.0)), seeds + np.array((60.0, 60.0))])
        owner = np.tile(owner, 3)
    pairs = SeedPairs(points, seeds, owner, np.arange(len(points)) < count)
    model: ModelName = "kannala_brandt" if random.uniform() < 0.3 else "brown_conrady"
    f = float(random.uniform(0.3, 1.3)) * _SIZE[0]
    rest = [0.0] * (4 if model == "kannala_brandt" else 6)
    lens = Lens(model, np.array([f, f, 959.5, 539.5, *rest])) if random.uniform() < 0.75 else None
    return bool(search_mounts(pairs, lens, model, _SIZE))


def _walk(random: np.random.Generator, count: int) -> Floats:
    """Vertices (N, 3): of a walk, or of still poses anywhere."""
    if random.uniform() < 0.4:
        return random.uniform((2.0, -2.5, -0.6), (12.0, 2.5, 0.9), (count, 3))
    steps = random.normal(0.0, (0.5, 0.35, 0.08), (count, 3))
    path = np.cumsum(steps, axis=0) + np.array((6.0, 0.0, 0.2))
    return np.clip(path, (2.0, -4.0, -0.8), (20.0, 4.0, 1.2))


def _seeds(random: np.random.Generator, count: int) -> Floats:
    """Seeds (N, K, 2): anywhere, in one place, of somebody else's way, or of blinking things in a few places."""
    kinds = int(random.integers(0, 4))
    each = int(random.integers(1, 4))
    if kinds == 0:
        middle = random.uniform((0.0, 0.0), _SIZE, (count, 1, 2))
    elif kinds == 1:
        middle = np.array([[[900.0, 400.0]]]) + random.normal(0.0, random.uniform(1.0, 60.0), (count, 1, 2))
    elif kinds == 2:
        way = np.cumsum(random.normal(0.0, (70.0, 12.0), (count, 2)), axis=0) + np.array((960.0, 420.0))
        middle = np.mod(way, _SIZE)[:, None]
    else:
        places = random.uniform((0.0, 0.0), _SIZE, (3, 2))
        middle = places[random.integers(0, 3, count)][:, None] + random.normal(0.0, 4.0, (count, 1, 2))
    return middle + random.normal(0.0, 50.0, (count, each, 2)) * (np.arange(each) > 0)[None, :, None]
