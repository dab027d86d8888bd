# SPDX-License-Identifier: Apache-2.0
"""Watcher of roscore: whether it is reachable, and whether it was restarted.

rospy registers a topic only once. After a restart of roscore, other nodes can't find the topics of
this node, so a restart ends the node. A thread polls roscore, because a reply may take long.
"""

from __future__ import annotations

import threading
from typing import Callable

import rosgraph

PERIOD_S = 1.0


def wait_for_master(is_over: Callable[[], bool], say: Callable[[str], object]) -> bool:
    """Wait for roscore; return False if `is_over` becomes true first."""
    has_said = False
    pause = threading.Event()
    while not is_over():
        if rosgraph.is_master_online():
            return True
        if not has_said:
            say(f"waiting for roscore at {rosgraph.get_master_uri()} (ROS_MASTER_URI)")
            has_said = True
        pause.wait(0.1)
    return False


class MasterWatch:
    """Watcher that polls roscore once a second."""

    def __init__(self, name: str) -> None:
        self.is_another = False
        """Whether roscore was restarted."""
        self._master = rosgraph.Master(name)
        self._first = self._master.getPid()
        self._bridge = threading.Event()
        threading.Thread(target=self._run, name="roscore", daemon=True).start()

    def close(self) -> None:
        """Stop polling."""
        self._bridge.set()

    def _run(self) -> None:
        while not self._bridge.wait(PERIOD_S):
            try:
                self.is_another = self._master.getPid() != self._first
            except (OSError, rosgraph.MasterException):
                continue  # established connections work without roscore
