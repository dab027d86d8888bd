# SPDX-License-Identifier: Apache-2.0
"""World queries from ROS pass through the gateway as they are, each once."""

import json
import random
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest

from groundlink.bus.control_client import WORLD_SECONDS, ask_world
from groundlink.core.errors import UserError
from groundlink.episode.control import ControlAnswer
from services.gateway.request_queue import RequestQueue
from services.gateway.run_commands import execute_run_command
from services.gateway.world_queries import execute_world_query
from udp_bridge.node import command_client
from udp_bridge.node.command_client import QUERY_TIMEOUT_S, RunCommandClient
from udp_bridge.wire import control
from udp_bridge.wire.control import RunCommand, RunCommandReply, WorldQuery, WorldReply
from udp_bridge.wire.run_commands import QUERY
from udp_bridge.wire.world_queries import TEXT_BYTES, pack_text, unpack_text

GATEWAY = ("127.0.0.1", 7510)
LOSS = 0.4


class LossyLink:
    """The real client and the real queues; between them, bodies are lost in both directions."""

    def __init__(self, ask: Callable[[bytes], bytes]) -> None:
        self._random = random.Random(3)
        self.lost = 0
        self.client = RunCommandClient(self._to_gateway)
        self.client.gateway_seen(GATEWAY)
        self.world_queries = RequestQueue(partial(execute_world_query, ask), backlog=[])
        self.run_commands = RequestQueue(
            partial(execute_run_command, lambda command: ControlAnswer("", 40)), backlog=[]
        )
        self.world_queries.reply_with(self._to_ros)
        self.run_commands.reply_with(self._to_ros)

    def close(self) -> None:
        self.client.close()
        self.world_queries.close()
        self.run_commands.close()

    def _arrives(self) -> bool:
        is_lost = self._random.random() < LOSS
        self.lost += is_lost
        return not is_lost

    def _to_gateway(self, request: RunCommand | WorldQuery, to: object) -> None:
        if self._arrives():
            body = control.parse(request.pack())
            if isinstance(body, WorldQuery):
                self.world_queries.put(body)
            elif isinstance(body, RunCommand):
                self.run_commands.put(body)

    def _to_ros(self, reply: RunCommandReply | WorldReply) -> None:
        if self._arrives():
            body = control.parse(reply.pack())
            assert isinstance(body, RunCommandReply | WorldReply)
            self.client.reply_received(body, GATEWAY)


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_client, "REPEAT_S", 0.005)


@pytest.mark.usefixtures("fast")
def test_with_losses_each_query_is_answered_and_executed_once() -> None:
    executed: list[bytes] = []

    def ask(query: bytes) -> bytes:
        executed.append(query)
        return b"answer to " + query

    link = LossyLink(ask)
    texts = [json.dumps({"query": "spawn", "name": f"skrzynia-ż{i}"}) for i in range(40)]
    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(link.client.ask, texts))
    link.close()
    assert answers == [f"answer to {text}" for text in texts]
    assert sorted(executed) == sorted(text.encode() for text in texts)
    assert link.lost > 20


@pytest.mark.usefixtures("fast")
def test_a_long_query_does_not_delay_run_commands() -> None:
    is_commanded = threading.Event()

    def ask(_: bytes) -> bytes:
        assert is_commanded.wait(10)
        return b"{}"

    link = LossyLink(ask)
    with ThreadPoolExecutor(1) as threads:
        answer = threads.submit(link.client.ask, "{}")
        assert link.client.call(QUERY).tick == 40
        assert not answer.done()
        is_commanded.set()
        assert answer.result(10) == "{}"
    link.close()


def failing(error: Exception) -> Callable[[bytes], bytes]:
    def ask(_: bytes) -> bytes:
        raise error

    return ask


@pytest.mark.parametrize(
    ("ask", "packed", "error"),
    [
        (failing(UserError("physics does not answer")), pack_text("{}"), "physics does not answer"),
        (failing(AssertionError()), b"no zlib", "the query's text is refused: body_value"),
        (
            lambda _: b" " * (TEXT_BYTES + 1),
            pack_text("{}"),
            "the answer is too large for one datagram: the text has 4194305 bytes; at most 4194304 "
            "are possible",
        ),
    ],
)
def test_what_cannot_be_answered_is_answered_with_an_error(
    ask: Callable[[bytes], bytes], packed: bytes, error: str
) -> None:
    reply = execute_world_query(ask, WorldQuery(7, packed))
    assert reply.number == 7
    assert json.loads(unpack_text(reply.packed_text)) == {"error": error, "code": "failed"}


class Queryables:
    """A bus on which physics, if it is there, answers queries of one key."""

    def __init__(self, *replies: bytes) -> None:
        self.asked: list[tuple[str, bytes, float]] = []
        self._replies = replies

    def query(self, key: str, *, seconds: float, content: bytes) -> dict[str, bytes]:
        self.asked.append((key, content, seconds))
        return {f"{key}/{i}": reply for i, reply in enumerate(self._replies)}


def test_the_text_is_the_payload_of_a_query_on_the_bus() -> None:
    bus: Any = Queryables(b'{"tick": 4}')
    assert ask_world(bus, "lab", b'{"query": "world"}') == b'{"tick": 4}'
    assert bus.asked == [("groundlink/lab/world", b'{"query": "world"}', WORLD_SECONDS)]
    nobody: Any = Queryables()
    with pytest.raises(UserError, match=r"^run `lab`: physics does not answer\. Fix: "):
        ask_world(nobody, "lab", b"{}")


def test_the_client_waits_longer_than_the_gateway() -> None:
    assert QUERY_TIMEOUT_S > WORLD_SECONDS + 0.5
