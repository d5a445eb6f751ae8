"""Random generators by purpose: one draw more for one thing shifts nothing else."""

from __future__ import annotations

import zlib

import numpy as np


def generator(seed: int, purpose: str, *keys: int) -> np.random.Generator:
    """A generator for one purpose and key of one seed. Keys may be negative (32-bit)."""
    words = [seed, zlib.crc32(purpose.encode()), *(key & 0xFFFFFFFF for key in keys)]
    return np.random.default_rng(np.random.SeedSequence(words))
