# SPDX-License-Identifier: Apache-2.0
"""The gateway's sockets: emulation, guard and seal around a real one, between real links."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundlink.core.errors import UserError
from groundlink.emulation.model import OUTCOMES
from groundlink.emulation.script import LinkEvent, LinkScript
from groundlink.emulation.settings import Impairment
from groundlink.scenario.ros_side import GatewaySettings
from services.gateway.carrier import sockets
from services.gateway.emulated_socket import EmulatedSocket
from udp_bridge import Link, Message
from udp_bridge.io.socket_wrappers import SealedSocket
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.wire.seal import FROM_ROS

LOCAL = ("127.0.0.1", 0)
SECRET = "00112233445566778899aabbccddeeff"
MS = 1_000_000


def wait_for(condition: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline, "the condition never came true"
        time.sleep(0.002)


class Endpoints:
    """A gateway's link with emulation, and the link on the ROS side."""

    def __init__(self, stack: ExitStack, script: LinkScript, *, key_file: str | None = None):
        bare = UdpSocket(LOCAL, receive_buffer=4 << 20, wait_s=0.05)
        secret = bytes.fromhex(SECRET)
        around = SealedSocket(bare, secret, sends=FROM_ROS) if key_file else bare
        self.at_ros: list[tuple[Message, Any]] = []
        self.at_gateway: list[Message] = []
        self.ros = stack.enter_context(
            Link(LOCAL, socket=around, on_message=lambda *both: self.at_ros.append(both))
        )
        settings = GatewaySettings(key_file=key_file, link=script)
        around, emulated = sockets(settings, LOCAL, self.ros.address, None)
        assert emulated is not None
        self.emulated: EmulatedSocket = emulated
        self.gateway = stack.enter_context(
            Link(
                LOCAL,
                self.ros.address,
                socket=around,
                on_message=lambda message, _: self.at_gateway.append(message),
            )
        )

    def counts(self, direction: str) -> dict[str, int]:
        prefix = f"link_{direction}_"
        return {
            name[len(prefix) :]: count
            for name, count in self.emulated.counters().items()
            if name.startswith(prefix)
        }


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if name.startswith(("udp_bridge", "link emulation"))]


@pytest.fixture
def key_file(tmp_path: Path) -> str:
    file = tmp_path / "key"
    file.write_text(SECRET)
    file.chmod(0o600)
    return str(file)


def test_both_ways_are_delayed_and_nothing_is_lost(stack: ExitStack) -> None:
    delay = Impairment(delay_ms=20)
    endpoints = Endpoints(stack, LinkScript(to_ros=delay, from_ros=delay))
    began = time.monotonic_ns()
    body = bytes(range(256)) * 4000
    endpoints.gateway.send(1, "/points", "lidar", 1, body)
    wait_for(lambda: endpoints.at_ros)
    assert time.monotonic_ns() - began >= 20 * MS
    assert endpoints.at_ros[0][0].body == body
    began = time.monotonic_ns()
    endpoints.ros.send(9, "/cmd_vel", "", 1, b"twist", to=endpoints.gateway.address)
    wait_for(lambda: endpoints.at_gateway)
    assert time.monotonic_ns() - began >= 20 * MS
    # 16 parts, and requests for a Credit as long as none comes.
    assert endpoints.counts("to_ros")["delivered"] == endpoints.counts("to_ros")["datagrams"] > 16


def test_the_script_follows_sim_time_and_queries_change_it(stack: ExitStack) -> None:
    endpoints = Endpoints(stack, LinkScript(events=(LinkEvent(at_s=10, to_ros={"outage": True}),)))

    def send() -> dict[str, int]:
        endpoints.gateway.send(8, "/clock", "", 1, b"x")
        assert endpoints.gateway.flush(5)
        return endpoints.counts("to_ros")

    endpoints.emulated.at(9_990 * MS)
    assert send()["outage"] == 0
    endpoints.emulated.at(10_000 * MS)
    assert send()["outage"] == 1
    ((reply,),) = [endpoints.emulated.answer("to_ros.outage=false;from_ros.loss=0.25")]
    error, settings = msgspec.json.decode(reply)
    assert not error
    assert (settings["to_ros"]["outage"], settings["from_ros"]["loss"]) == (False, 0.25)
    assert send()["outage"] == 1
    endpoints.emulated.at(20_000 * MS)
    assert send()["outage"] == 1


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("nonsense", "expected DIRECTION.FIELD=VALUE"),
        ("to_ros.los=1", "did you mean `loss`?"),
        ("to_ros.loss=0.5;both.loss=1", "unknown direction `both`"),
        ("to_ros.outage=yes", "expected DIRECTION.FIELD=VALUE"),
        ("to_ros.loss=7", "`loss`"),
    ],
)
def test_a_wrong_query_changes_nothing(stack: ExitStack, query: str, words: str) -> None:
    endpoints = Endpoints(stack, LinkScript())
    (reply,) = endpoints.emulated.answer(query)
    error, settings = msgspec.json.decode(reply)
    assert words in error
    assert settings == msgspec.to_builtins({"to_ros": Impairment(), "from_ros": Impairment()})


def test_counters_add_up_under_everything_at_once(stack: ExitStack) -> None:
    bad = Impairment(
        loss=0.1, burst=2, duplicate=0.1, reorder=0.1, delay_ms=2, jitter_ms=2, bit_errors=1e-4
    )
    endpoints = Endpoints(stack, LinkScript(to_ros=bad, from_ros=bad, seed=3))
    for index in range(500):
        endpoints.gateway.send(8, "/clock", "", index, bytes(100))
    assert endpoints.gateway.flush(10)
    wait_for(lambda: endpoints.counts("to_ros")["waiting"] == 0)
    counts = endpoints.counts("to_ros")
    assert counts["datagrams"] == 500
    assert counts["datagrams"] + counts["duplicated"] == sum(
        counts[outcome] for outcome in OUTCOMES
    )
    assert min(counts[name] for name in ("lost", "duplicated", "corrupted", "delayed")) > 0
    wait_for(lambda: endpoints.ros.counters()["received_datagrams"] == counts["delivered"])
    assert endpoints.ros.counters()["refused"] == {}


def test_with_a_key_bit_errors_meet_the_seal(stack: ExitStack, key_file: str) -> None:
    bad = Impairment(bit_errors=2e-4)
    endpoints = Endpoints(stack, LinkScript(to_ros=bad, from_ros=bad), key_file=key_file)
    for index in range(200):
        endpoints.gateway.send(8, f"/{index}", "", index, bytes(300))
    assert endpoints.gateway.flush(10)
    wait_for(lambda: endpoints.ros.counters()["received_datagrams"] == 200)
    flipped = endpoints.counts("to_ros")["flipped"]
    assert flipped > 20
    assert endpoints.counts("to_ros")["corrupted"] == 0
    refused = endpoints.ros.counters()["refused"]
    assert sum(refused.values()) == flipped
    assert set(refused) <= {"bad_tag", "unsealed"}
    assert {bytes(message.body) for message, _ in endpoints.at_ros} == {bytes(300)}
    assert len(endpoints.at_ros) == 200 - flipped


def test_unknown_senders_get_no_link(stack: ExitStack) -> None:
    endpoints = Endpoints(stack, LinkScript())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.2", 0))
        for _ in range(20):
            stranger.sendto(b"x" * 100, endpoints.gateway.address)
    wait_for(lambda: endpoints.gateway.counters()["refused"] == {"stranger": 20})
    assert endpoints.counts("from_ros")["datagrams"] == 0


@pytest.mark.parametrize("peers", [("127.0.0.2",), ("localhost", "127.0.0.2:0")])
def test_other_peers_may_be_named(stack: ExitStack, peers: tuple[str, ...]) -> None:
    around, emulated = sockets(GatewaySettings(peers=peers), LOCAL, ("127.0.0.1", 9), None)
    assert emulated is None
    received: list[Message] = []
    link = stack.enter_context(
        Link(LOCAL, socket=around, on_message=lambda message, _: received.append(message))
    )
    for number, host in enumerate(("127.0.0.1", "127.0.0.2", "127.0.0.3")):
        sender = stack.enter_context(Link((host, 0), link.address))
        sender.send(9, f"/cmd_vel{number}", "", 1, b"twist")
    wait_for(lambda: link.counters()["refused"] == {"stranger": 1} and len(received) == 2)


def test_keys_that_cannot_be_used_are_the_users_to_mend(key_file: str) -> None:
    Path(key_file).chmod(0o644)
    with pytest.raises(UserError, match="chmod 600"):
        sockets(GatewaySettings(key_file=key_file), LOCAL, ("127.0.0.1", 9), None)
    with pytest.raises(UserError, match="no variable NO_SUCH_KEY"):
        sockets(GatewaySettings(key_env="NO_SUCH_KEY"), LOCAL, ("127.0.0.1", 9), None)
    with pytest.raises(ValueError, match="keep one"):
        GatewaySettings(key_file="a", key_env="b")


def test_closing_waits_for_nothing_that_is_on_the_way(stack: ExitStack) -> None:
    endpoints = Endpoints(stack, LinkScript(to_ros=Impairment(delay_ms=60_000)))
    endpoints.gateway.send(8, "/clock", "", 1, b"x")
    wait_for(lambda: endpoints.counts("to_ros")["waiting"] == 1)
    began = time.monotonic()
    endpoints.gateway.close()
    assert time.monotonic() - began < 10


def test_due_datagrams_do_not_wait_for_a_timeout(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.gateway.emulated_socket.WAIT_SECONDS", 3600.0)
    endpoints = Endpoints(stack, LinkScript(from_ros=Impairment(delay_ms=20)))
    endpoints.ros.send(9, "/cmd_vel", "", 1, b"twist", to=endpoints.gateway.address)
    wait_for(lambda: endpoints.at_gateway)


@pytest.mark.parametrize("missing_bytes", [0, 4096])
def test_small_receive_buffer_gives_one_line(
    missing_bytes: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def granted(bind: Any, *, receive_buffer: int, wait_s: float) -> UdpSocket:
        bare = UdpSocket(bind, receive_buffer=receive_buffer, wait_s=wait_s)
        bare.receive_buffer = receive_buffer - missing_bytes
        return bare

    monkeypatch.setattr("services.gateway.carrier.UdpSocket", granted)
    around, _ = sockets(GatewaySettings(), LOCAL, ("127.0.0.1", 9), None)
    around.close()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == (1 if missing_bytes else 0)
    assert all(line.startswith("gateway: the receive buffer is ") for line in lines)
