# SPDX-License-Identifier: Apache-2.0
"""Processes under test: each with its own environment, read line by line, always ended."""

import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

TIMEOUT_S = 20.0
"""How long to wait for what must come; long, as it only matters when something is broken."""


class Process:
    """A Python process whose output is collected as it comes."""

    def __init__(
        self,
        arguments: Sequence[str],
        environment: dict[str, str],
        *,
        python: str = sys.executable,
    ) -> None:
        self.lines: list[str] = []
        self._rows: dict[str, list[list[Any]]] = {}
        self._lines_read = 0
        self._changed = threading.Condition()
        self._process = subprocess.Popen(
            [python, *arguments],
            env=environment,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def output(self) -> str:
        return "\n".join(list(self.lines))

    @property
    def end_of_output(self) -> str:
        return "\n".join(self.lines[-20:])

    def wait_until(
        self, is_enough: Callable[[], Any], what: str, *, timeout_s: float = TIMEOUT_S
    ) -> None:
        """Wait for output that satisfies the condition, or fail with all that there was."""
        with self._changed:
            if not self._changed.wait_for(is_enough, timeout_s):
                raise AssertionError(
                    f"{what} did not come; the last output was:\n{self.end_of_output}"
                )

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait for a line that matches; return the match."""
        self.wait_until(lambda: re.search(pattern, self.output), pattern)
        match = re.search(pattern, self.output)
        assert match
        return match

    def messages(self, topic: str) -> list[tuple[int, Any]]:
        """Return stamp and content of what a listener or talker told of a topic."""
        return [(stamp, content) for _, stamp, content, *_ in self._rows_of(topic)]

    def frames(self, topic: str) -> set[Any]:
        """Return the frames of all messages of a topic that a listener told of."""
        return {row[3] for row in self._rows_of(topic)}

    def wait_for_stamp(self, topic: str, stamp_nanos: int) -> None:
        """Wait for a message of this very stamp."""
        start = json.dumps([topic, stamp_nanos, None])[: -len("null]")]
        self.wait_until(lambda: any(line.startswith(start) for line in self.lines), start)

    def end(self, number: signal.Signals = signal.SIGTERM, timeout_s: float = TIMEOUT_S) -> int:
        """Send a signal, if it still runs; return the exit code."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        return self.exit_code(timeout_s)

    def exit_code(self, timeout_s: float = TIMEOUT_S) -> int:
        """Wait for the end; return the exit code."""
        try:
            code = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise AssertionError(
                f"it did not end; the last output was:\n{self.end_of_output}"
            ) from None
        finally:
            self._reader.join(TIMEOUT_S)
            assert self._process.stdout
            self._process.stdout.close()
        return code

    def _rows_of(self, topic: str) -> list[list[Any]]:
        """Return the rows of a topic; a line is read once, for who waits looks at each new one."""
        with self._changed:
            for line in self.lines[self._lines_read :]:
                if line.startswith('["'):
                    row = json.loads(line)
                    self._rows.setdefault(row[0], []).append(row)
            self._lines_read = len(self.lines)
            return self._rows.get(topic, [])

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            with self._changed:
                self.lines.append(line.rstrip("\n"))
                self._changed.notify_all()
