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
        self._keys: dict[str, int] = {}

    def at(self, purpose: str, tick: int) -> np.random.Generator:
        """Return the generator for a purpose (`"range"`, `"bias"`) at a tick.

        Philox (Salmon et al. 2011) with the purpose hashed into its 128-bit key and the tick as the
        upper half of its 256-bit counter: streams of different ticks never overlap.
        """
        key = self._keys.get(purpose)
        if key is None:
            digest = hashlib.sha256(self._prefix + purpose.encode()).digest()
            key = self._keys[purpose] = int.from_bytes(digest[:16], "little")
        return np.random.Generator(np.random.Philox(key=key, counter=tick << 128))
