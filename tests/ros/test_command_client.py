# SPDX-License-Identifier: Apache-2.0
"""Commands to a gateway that loses some, is silent, or is one of several."""

import threading
from collections.abc import Callable

import pytest

from udp_bridge.node.command_client import PRESENT_NANOS, CommandFailed, RunCommandClient
from udp_bridge.wire.run_commands import PAUSE, PAUSED, RESET, RUNNING, RunCommand, RunCommandReply
from udp_bridge.wire.world_queries import TEXT_BYTES, WorldQuery, WorldReply, pack_text, unpack_text

GATEWAY = ("127.0.0.1", 7510)
OTHER = ("127.0.0.1", 7520)

Reply = Callable[[RunCommand, int], RunCommandReply | None]
"""Returns the gateway's reply to a command that arrived so often before."""


class Gateway:
    """Stands for the link and the gateway behind it."""

    def __init__(self, reply: Reply) -> None:
        self.commands: list[tuple[RunCommand, tuple[str, int]]] = []
        self.now_nanos = 0
        self._reply = reply
        self.client = RunCommandClient(self.send, timeout_s=0.5, now_nanos=lambda: self.now_nanos)

    def send(self, command: RunCommand, to: tuple[str, int]) -> None:
        before = sum(earlier.number == command.number for earlier, _ in self.commands)
        self.commands.append((command, to))
        if answer := self._reply(command, before):
            self.client.reply_received(answer, to)


def paused(command: RunCommand, before: int) -> RunCommandReply:
    return RunCommandReply(command.number, PAUSED, 7)


def test_a_command_is_answered() -> None:
    gateway = Gateway(paused)
    gateway.client.gateway_seen(GATEWAY)
    assert gateway.client.call(PAUSE).tick == 7
    [(command, to)] = gateway.commands
    assert (command.action, command.ticks, to) == (PAUSE, 0, GATEWAY)


def test_lost_command_is_repeated_with_its_number() -> None:
    gateway = Gateway(lambda command, before: paused(command, before) if before == 2 else None)
    gateway.client.gateway_seen(GATEWAY)
    gateway.client.call(RESET)
    assert len(gateway.commands) == 3
    assert len({command.number for command, _ in gateway.commands}) == 1


def test_each_command_has_a_number_of_its_own_that_grows() -> None:
    gateway = Gateway(paused)
    gateway.client.gateway_seen(GATEWAY)
    for _ in range(20):
        gateway.client.call(PAUSE)
    numbers = [command.number for command, _ in gateway.commands]
    assert numbers == sorted(set(numbers))


def test_answers_to_others_and_of_others_count_for_nothing() -> None:
    def reply(command: RunCommand, before: int) -> None:
        gateway.client.reply_received(RunCommandReply(command.number + 1, RUNNING, 1), GATEWAY)
        gateway.client.reply_received(RunCommandReply(command.number, RUNNING, 1), OTHER)

    gateway = Gateway(reply)
    gateway.client.gateway_seen(GATEWAY)
    with pytest.raises(
        CommandFailed, match=r"the gateway at 127\.0\.0\.1:7510 was silent for 0\.5 s"
    ):
        gateway.client.call(PAUSE)


def test_why_it_could_not_be_done() -> None:
    gateway = Gateway(
        lambda command, _: RunCommandReply(command.number, RUNNING, 1, "physics is busy")
    )
    gateway.client.gateway_seen(GATEWAY)
    with pytest.raises(CommandFailed, match=r"^physics is busy$"):
        gateway.client.call(PAUSE)


def test_only_gateway_gets_commands_after_silence() -> None:
    gateway = Gateway(paused)
    gateway.client.gateway_seen(OTHER)
    gateway.now_nanos = PRESENT_NANOS
    gateway.client.call(PAUSE)
    gateway.client.gateway_seen(GATEWAY)
    for gateway.now_nanos in (PRESENT_NANOS, 10 * PRESENT_NANOS):
        gateway.client.call(PAUSE)
    assert [to for _, to in gateway.commands] == [OTHER, GATEWAY, GATEWAY]


def test_where_there_was_never_a_gateway() -> None:
    gateway = Gateway(paused)
    with pytest.raises(CommandFailed, match="no gateway found"):
        gateway.client.call(PAUSE)
    assert gateway.commands == []


def test_a_gateway_that_comes_is_waited_for() -> None:
    gateway = Gateway(paused)
    timer = threading.Timer(0.15, gateway.client.gateway_seen, [GATEWAY])
    timer.start()
    assert gateway.client.call(PAUSE).tick == 7
    timer.join()


def test_which_of_two_gateways_is_not_guessed() -> None:
    gateway = Gateway(paused)
    gateway.client.gateway_seen(OTHER)
    gateway.client.gateway_seen(GATEWAY)
    with pytest.raises(CommandFailed, match=r"127\.0\.0\.1:7510, 127\.0\.0\.1:7520. Fix: name one"):
        gateway.client.call(PAUSE)
    assert gateway.commands == []


def test_no_command_waits_after_the_end() -> None:
    gateway = Gateway(lambda command, before: gateway.client.close())
    gateway.client.gateway_seen(GATEWAY)
    with pytest.raises(CommandFailed, match="the bridge is ending"):
        gateway.client.call(PAUSE)
    assert len(gateway.commands) == 1


class WorldGateway:
    """Stands for the link and a gateway that answers world queries."""

    def __init__(self, reply: Callable[[WorldQuery, int], object]) -> None:
        self.queries: list[WorldQuery] = []
        self._reply = reply
        self.client = RunCommandClient(self.send, query_timeout_s=0.3)
        self.client.gateway_seen(GATEWAY)

    def send(self, query: object, to: tuple[str, int]) -> None:
        assert isinstance(query, WorldQuery)
        self.queries.append(query)
        self._reply(query, len(self.queries) - 1)

    def answer(self, query: WorldQuery, text: str = "") -> None:
        packed = pack_text(text or unpack_text(query.packed_text).upper())
        self.client.reply_received(WorldReply(query.number, packed), GATEWAY)


def test_a_lost_query_is_repeated_with_its_number_and_answered() -> None:
    gateway = WorldGateway(lambda query, before: before == 2 and gateway.answer(query))
    assert gateway.client.ask("{ż}") == "{Ż}"
    assert len(gateway.queries) == 3
    assert len(set(gateway.queries)) == 1


def test_queries_and_commands_are_numbered_together_and_not_confused() -> None:
    def reply(query: WorldQuery, before: int) -> None:
        gateway.client.reply_received(RunCommandReply(query.number, RUNNING, 1), GATEWAY)
        gateway.client.reply_received(WorldReply(query.number, pack_text("no")), OTHER)
        gateway.client.reply_received(WorldReply(query.number - 1, pack_text("no")), GATEWAY)
        gateway.answer(query)

    gateway = WorldGateway(reply)
    assert [gateway.client.ask(text) for text in "abc"] == ["A", "B", "C"]
    numbers = [query.number for query in gateway.queries]
    assert numbers == sorted(set(numbers))


def test_a_gateway_that_does_not_know_queries_is_named() -> None:
    gateway = WorldGateway(lambda query, before: None)
    with pytest.raises(
        CommandFailed,
        match=r"^the gateway at 127\.0\.0\.1:7510 was silent for 0\.3 s; one of an older version "
        r"does not answer world queries\. Fix: .*$",
    ):
        gateway.client.ask("{}")
    assert len(gateway.queries) == 3


def test_text_that_cannot_be_sent_or_read() -> None:
    gateway = WorldGateway(
        lambda query, before: gateway.client.reply_received(
            WorldReply(query.number, b"no zlib"), GATEWAY
        )
    )
    with pytest.raises(CommandFailed, match=r"the query can't be sent: .* at most 4194304"):
        gateway.client.ask(" " * (TEXT_BYTES + 1))
    assert gateway.queries == []
    with pytest.raises(CommandFailed, match="the gateway's answer can't be read: body_value"):
        gateway.client.ask("{}")
