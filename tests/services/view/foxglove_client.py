# SPDX-License-Identifier: Apache-2.0
"""A client of Foxglove's WebSocket protocol that knows of ROS only what it is told."""

import json
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
MESSAGE_DATA, TIME, PLAYBACK_STATE = 1, 2, 5
"""First byte of the protocol's binary messages."""

PLAYBACK_CONTROL = 3
"""The same of messages to the server."""

PLAYING, PAUSED, BUFFERING, ENDED = range(4)
"""Status of a playback."""


class Client:
    """One connection, and all that came by it."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.channels: dict[str, dict[str, Any]] = {}
        self.times: list[int] = []
        self.got: list[tuple[str, int, bytes]] = []
        self.states: list[tuple[int, int]] = []
        """Status and current time of the playback."""

    def read(self, quiet: float = 0.2, *, at_most: float = 5.0) -> None:
        """Take what comes until nothing has come for so many seconds."""
        end = time.monotonic() + at_most
        while time.monotonic() < end:
            try:
                frame = self.socket.recv(timeout=quiet)
            except TimeoutError:
                return
            self._take(frame)

    def _take(self, frame: str | bytes) -> None:
        if isinstance(frame, str):
            for channel in json.loads(frame).get("channels", ()):
                self.channels[channel["topic"]] = channel
        elif frame[0] == MESSAGE_DATA:
            number, stamp = struct.unpack_from("<IQ", frame, 1)
            topic = next(t for t, c in self.channels.items() if c["id"] == number)
            self.got.append((topic, stamp, frame[13:]))
        elif frame[0] == PLAYBACK_STATE:
            self.states.append(struct.unpack_from("<BQ", frame, 1))
        elif frame[0] == TIME:
            self.times.append(struct.unpack_from("<Q", frame, 1)[0])

    def subscribe(self, *topics: str) -> None:
        subscriptions = [
            {"id": self.channels[t]["id"], "channelId": self.channels[t]["id"]} for t in topics
        ]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def control(self, *, play: bool, seek_nanos: int | None = None) -> None:
        """Ask the server to play or to pause, perhaps somewhere else."""
        fields = (PLAYBACK_CONTROL, not play, 1.0, seek_nanos is not None, seek_nanos or 0)
        self.socket.send(struct.pack("<BBf?QI", *fields, 2) + b"id")

    def decoded(self, topic: str) -> Any:
        """Return the newest message of a topic, read by the advertised definition."""
        channel = self.channels[topic]
        schema = Schema(
            id=1,
            name=channel["schemaName"],
            encoding=channel["schemaEncoding"],
            data=channel["schema"].encode(),
        )
        decode = DecoderFactory().decoder_for(channel["encoding"], schema)
        assert decode is not None
        return decode(next(body for t, _, body in reversed(self.got) if t == topic))


@contextmanager
def joined(port: int) -> Iterator[Client]:
    """Join a server and read what it advertises."""
    address = f"ws://127.0.0.1:{port}"
    with connect(address, subprotocols=[SUBPROTOCOL], max_size=None) as socket:
        client = Client(socket)
        end = time.monotonic() + 20
        while not client.channels and time.monotonic() < end:  # a busy machine
            client.read()
        yield client
