# SPDX-License-Identifier: Apache-2.0
"""Trace of a lockstep run: what ROS got and what it answered, as JSON lines in a file.

Two runs of the same scenario have the same lines for each topic, but for padding bytes of answers,
which DDS leaves undefined. Lines of different topics may come in another order, since DDS has none
between publishers. Messages to ROS are written as a digest, answers with their bodies.
"""

from __future__ import annotations

import base64
import hashlib
import json
from threading import Lock
from typing import TYPE_CHECKING, Any, Dict, Optional

if TYPE_CHECKING:
    from udp_bridge.wire.header import Buffer


class LockstepTrace:
    """Writes lines; safe to call from any thread.

    Parameters
    ----------
    path
        The file, which is replaced.

    Raises
    ------
    OSError
        When the file can't be written.
    """

    def __init__(self, path: str) -> None:
        self._file = open(path, "w", buffering=1, encoding="utf-8")
        self._lock = Lock()

    def published(self, tick: int, topic: str, stamp_nanos: int, body: Buffer) -> None:
        """Write a message that ROS gets at a tick."""
        self._write("to_ros", tick, topic, stamp_nanos, body, {})

    def received(
        self, tick: int, topic: str, stamp_nanos: Optional[int], body: Buffer, ros_type: str
    ) -> None:
        """Write a message of ROS; `stamp_nanos` is None without a header."""
        more = {"type": ros_type, "body": base64.b64encode(body).decode()}
        self._write("from_ros", tick, topic, stamp_nanos, body, more)

    def close(self) -> None:
        """Close the file; later messages are ignored."""
        with self._lock:
            self._file.close()

    def _write(
        self,
        direction: str,
        tick: int,
        topic: str,
        stamp_nanos: Optional[int],
        body: Buffer,
        more: Dict[str, str],
    ) -> None:
        line: Dict[str, Any] = {
            "direction": direction,
            "tick": tick,
            "topic": topic,
            "stamp_nanos": stamp_nanos,
            "sha256": hashlib.sha256(body).hexdigest(),
            **more,
        }
        with self._lock:
            if not self._file.closed:
                self._file.write(json.dumps(line) + "\n")
