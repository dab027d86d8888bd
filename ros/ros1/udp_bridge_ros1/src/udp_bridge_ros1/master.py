# SPDX-License-Identifier: Apache-2.0
"""Whether roscore is there, and still the same one.

Rule: rospy registers a topic once, so after a restart of roscore nobody would find this node's
topics any more: that ends the node, and who started it starts it again. Asked in a thread of its
own, as an answer may be long in coming.
"""

from __future__ import annotations

import threading
from typing import Callable

import rosgraph

PERIOD_S = 1.0


def wait_for_master(is_over: Callable[[], bool], say: Callable[[str], object]) -> bool:
    """Wait for roscore; return whether it is there, which it is not when waiting `is_over`."""
    has_said = False
    pause = threading.Event()
    while not is_over():
        if rosgraph.is_master_online():
            return True
        if not has_said:
            say(f"waits for roscore at {rosgraph.get_master_uri()} (ROS_MASTER_URI)")
            has_said = True
        pause.wait(0.1)
    return False


class MasterWatch:
    """Looks after roscore, once a second."""

    def __init__(self, name: str) -> None:
        self.is_another = False
        """Whether roscore has been started again."""
        self._master = rosgraph.Master(name)
        self._first = self._master.getPid()
        self._end = threading.Event()
        threading.Thread(target=self._run, name="roscore", daemon=True).start()

    def close(self) -> None:
        """Look no more."""
        self._end.set()

    def _run(self) -> None:
        while not self._end.wait(PERIOD_S):
            try:
                self.is_another = self._master.getPid() != self._first
            except (OSError, rosgraph.MasterException):
                continue  # topics that are connected go on without it
