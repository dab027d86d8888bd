# SPDX-License-Identifier: Apache-2.0
"""One PyBullet world in this process.

Rule: every Bullet call carries this world's client id; nobody else imports `pybullet`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from groundlink.core.clock import TICK_SECONDS


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what the C library prints while it loads (its build time) from the user's terminal."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _quiet():
    import pybullet

GRAVITY_MPS2 = 9.80665
"""Standard gravity (CGPM 1901), along -z of the world."""

SOLVER_ITERATIONS = 20
"""Of the contact solver in each step; the motion on springs is the same from 10 on."""


class Engine:
    """PyBullet's functions and constants, bound to a client of their own."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        self.setGravity(0, 0, -GRAVITY_MPS2)
        self.setPhysicsEngineParameter(
            fixedTimeStep=TICK_SECONDS,
            numSolverIterations=SOLVER_ITERATIONS,
            # Without it the order of contact pairs, and so the motion, may differ between runs.
            deterministicOverlappingPairs=1,
            # Files are cached by name for the episode of the process, whatever is in them.
            enableFileCaching=0,
            # How deep things may sink in unopposed; with none, a vehicle put down stays put.
            contactSlop=0,
        )
        self.unseen: int = self.createVisualShape(self.GEOM_SPHERE, radius=0.001)
        """What a body of many triangles is to look like: without a word, the engine keeps them all
        a second time to draw them, which nobody asks it to."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(pybullet, name)
        if callable(found):
            found = partial(found, physicsClientId=self._client)
        self.__dict__[name] = found
        return found

    def close(self) -> None:
        """Free the world; nothing can be called after it."""
        if self._client >= 0:
            self.disconnect()
            self._client = -1
