# SPDX-License-Identifier: Apache-2.0
"""The node on stubs of rclcpp: its graph is its terminal (`stubs/rclcpp/rclcpp.hpp`)."""

import random
import signal
import socket
import subprocess
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from tests.ros.waiting import wait_until
from tests.system.rig import free_port


class Published(NamedTuple):
    """A message that the node published."""

    topic: str
    ros_type: str
    qos: str
    body: bytes


class RclcppNode:
    """A running node; its log is `log`, its publications `published`."""

    def __init__(self, program: Path, share: Path, **parameters: str) -> None:
        self.address = "127.0.0.1", free_port()
        parameters.setdefault("bind", f"127.0.0.1:{self.address[1]}")
        self.log: list[str] = []
        self.published: list[Published] = []
        self.subscribed: list[str] = []
        given = [word for row in parameters.items() for word in ("-p", f"{row[0]}:={row[1]}")]
        environment: Mapping[str, str] = {"SHARE": str(share), "TSAN_OPTIONS": "exitcode=66"}
        self._process = subprocess.Popen(
            [str(program), "--ros-args", *given],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def say(self, *words: object) -> None:
        """Change the graph, or have a message come."""
        assert self._process.stdin
        print(*words, file=self._process.stdin, flush=True)

    def wait_for(self, text: str) -> None:
        wait_until(lambda: any(text in line for line in self.log), f"{text!r} in {self.log}")

    def end(self) -> int:
        """End the node as Ctrl+C does; return its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        return self.exit_code()

    def exit_code(self) -> int:
        """Wait for the end; return the exit code."""
        code = self._process.wait(30)
        self._reader.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe
            pipe.close()
        return code

    def __enter__(self) -> Self:
        self.wait_for("receiving at")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        code = self.end()
        if error is None:
            assert code == 0, "\n".join(self.log)

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            verb, _, rest = line.rstrip("\n").partition(" ")
            if verb == "publish":
                topic, ros_type, qos, body = rest.split(" ")
                self.published.append(Published(topic, ros_type, qos, bytes.fromhex(body)))
            elif verb == "subscribe":
                self.subscribed.append(rest)
            else:
                self.log.append(line.rstrip("\n"))


class LossyRelay:
    """Passes datagrams between one client and a node, and loses some of both directions."""

    def __init__(self, to: tuple[str, int], share: float, seed: int) -> None:
        self._to, self._share, self._rng = to, share, random.Random(seed)
        self.lost = 0
        self._client: tuple[str, int] | None = None
        self._outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self._outer.bind(("127.0.0.1", 0))
        self.address: tuple[str, int] = self._outer.getsockname()
        self._is_open = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._is_open = False
        self._thread.join()
        self._outer.close()

    def _run(self) -> None:
        self._outer.settimeout(0.05)
        while self._is_open:
            try:
                datagram, sender = self._outer.recvfrom(65536)
            except TimeoutError:
                continue
            if sender != self._to:
                self._client = sender
            to = self._to if sender != self._to else self._client
            if self._rng.random() < self._share:
                self.lost += 1
            elif to is not None:
                self._outer.sendto(datagram, to)
