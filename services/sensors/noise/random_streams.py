# SPDX-License-Identifier: Apache-2.0
"""Random streams keyed by seed, sensor, purpose and tick.

A sensor that is restarted, delayed or runs on another machine draws the same numbers. A generator
is used for one measurement only.
"""

import hashlib

import numpy as np


class RandomStreams:
    """The random streams of one sensor."""

    def __init__(self, seed: int, sensor: str) -> None:
        self._prefix = f"{seed}/{sensor}/".encode()
        self._keys: dict[str, tuple[int, int]] = {}

    def at(self, purpose: str, tick: int) -> np.random.Generator:
        """Return the generator for a purpose (`"range"`, `"bias"`) at a tick.

        Philox (Salmon et al. 2011) with the purpose hashed into its 128-bit key and the tick as the
        upper half of its 256-bit counter: streams of different ticks never overlap.
        """
        low, high = self.key(purpose)
        key = low | high << 64
        return np.random.Generator(np.random.Philox(key=key, counter=tick << 128))

    def key(self, purpose: str) -> tuple[int, int]:
        """Return the words of a purpose's key, of 64 bits, the low one first."""
        words = self._keys.get(purpose)
        if words is None:
            digest = hashlib.sha256(self._prefix + purpose.encode()).digest()
            low, high = (int.from_bytes(digest[i : i + 8], "little") for i in (0, 8))
            words = self._keys[purpose] = low, high
        return words
