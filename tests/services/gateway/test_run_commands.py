# SPDX-License-Identifier: Apache-2.0
"""Each run command from ROS is executed once and answered each time it comes; nothing blocks."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from groundlink.core.errors import UserError
from groundlink.episode.control import AnyRunCommand, ControlAnswer, Pause, Reset, Resume, Step
from groundlink.scenario.ros_side import GatewaySettings
from services.gateway.carrier import sockets
from services.gateway.request_queue import REPLIES_KEPT, REQUESTS_WAITING, RequestQueue
from services.gateway.run_commands import execute_run_command
from udp_bridge import Link, Message
from udp_bridge.io.address_guard import open_socket
from udp_bridge.wire import run_commands
from udp_bridge.wire.run_commands import PAUSED, RUNNING, STOPPED, RunCommand, RunCommandReply
from udp_bridge.wire.seal import FROM_ROS
from udp_bridge.wire.types import CONTROL


class Bench:
    """RequestQueue of run commands with a physics that answers when it is let."""

    def __init__(self) -> None:
        self.asked: list[AnyRunCommand | None] = []
        self.told: list[RunCommandReply] = []
        self.error = ""
        self.answers = threading.Event()
        self.answers.set()
        self.backlog: list[int] = []
        self._told = threading.Condition()
        self.commands = RequestQueue(partial(execute_run_command, self._ask), backlog=self.backlog)
        self.commands.reply_with(self._tell)

    def _ask(self, command: AnyRunCommand | None) -> ControlAnswer:
        self.asked.append(command)
        assert self.answers.wait(10)
        if self.error:
            raise UserError(self.error)
        return ControlAnswer("", 40 + len(self.asked), paused=isinstance(command, Pause))

    def _tell(self, answer: RunCommandReply) -> None:
        with self._told:
            self.told.append(answer)
            self._told.notify_all()

    def wait(self, is_enough: Callable[[], bool]) -> None:
        with self._told:
            assert self._told.wait_for(is_enough, 10), (self.asked, self.told)


@pytest.fixture
def bench() -> Iterator[Bench]:
    it = Bench()
    yield it
    it.answers.set()
    it.commands.close()


@pytest.mark.parametrize(
    ("command", "on_the_bus", "state"),
    [
        (RunCommand(5, run_commands.QUERY), None, RUNNING),
        (RunCommand(5, run_commands.PAUSE), Pause(), PAUSED),
        (RunCommand(5, run_commands.RESUME), Resume(), RUNNING),
        (RunCommand(5, run_commands.STEP, 7), Step(7), RUNNING),
        (RunCommand(5, run_commands.RESET), Reset(), RUNNING),
    ],
)
def test_each_command_is_executed_and_answered(
    bench: Bench, command: RunCommand, on_the_bus: AnyRunCommand | None, state: int
) -> None:
    bench.commands.put(command)
    bench.wait(lambda: len(bench.told) == 1)
    assert bench.asked == [on_the_bus]
    assert bench.told == [RunCommandReply(5, state, 41)]


def test_a_copy_is_answered_and_not_done(bench: Bench) -> None:
    for _ in range(3):
        bench.commands.put(RunCommand(5, run_commands.RESET))
    bench.wait(lambda: len(bench.told) == 1)
    bench.commands.put(RunCommand(5, run_commands.RESET))
    bench.wait(lambda: len(bench.told) == 2)
    assert bench.asked == [Reset()]
    assert bench.told[0] == bench.told[1]


def test_repeated_command_is_ignored_without_waiting(bench: Bench) -> None:
    bench.answers.clear()
    for number in (5, 5, 6, 5):
        bench.commands.put(
            RunCommand(number, run_commands.RESET)
        )  # returns while physics is silent
    assert bench.told == []
    bench.answers.set()
    bench.wait(lambda: len(bench.told) == 2)
    assert [answer.number for answer in bench.told] == [5, 6]
    assert bench.asked == [Reset(), Reset()]


def test_why_it_could_not_be_done(bench: Bench) -> None:
    bench.error = "physics of run `lab` does not answer " + 2000 * "ä"
    bench.commands.put(RunCommand(5, run_commands.PAUSE))
    bench.wait(lambda: len(bench.told) == 1)
    answer = RunCommandReply.parse(bench.told[0].pack())
    assert (answer.state, answer.tick) == (STOPPED, -1)
    assert answer.error.startswith("physics of run `lab` does not answer ä")


def test_reply_is_sent_after_queued_messages(bench: Bench) -> None:
    bench.backlog += [1, 2, 3]
    began = threading.Timer(0.1, bench.backlog.clear)
    began.start()
    bench.commands.put(RunCommand(5, run_commands.PAUSE))
    bench.wait(lambda: len(bench.told) == 1)
    assert bench.backlog == []
    began.join()


def test_so_many_wait_and_no_more(bench: Bench) -> None:
    bench.answers.clear()
    bench.commands.put(RunCommand(0, run_commands.PAUSE))
    while not bench.asked:  # until it is with physics and waits no longer
        time.sleep(0.001)
    for number in range(1, REQUESTS_WAITING + 10):
        bench.commands.put(RunCommand(number, run_commands.PAUSE))
    bench.answers.set()
    bench.wait(lambda: len(bench.told) == REQUESTS_WAITING + 1)
    bench.commands.put(RunCommand(5000, run_commands.PAUSE))
    bench.wait(lambda: bench.told[-1].number == 5000)
    assert [answer.number for answer in bench.told[:-1]] == list(range(REQUESTS_WAITING + 1))


def test_memory_is_bounded(bench: Bench) -> None:
    bench.answers.clear()
    for number in range(1000):
        bench.commands.put(RunCommand(number, run_commands.PAUSE))
    bench.answers.set()
    bench.wait(lambda: len(bench.told) >= REQUESTS_WAITING)
    assert len(bench.told) <= REQUESTS_WAITING + 1  # one is with physics
    first = bench.told[0].number
    for number in range(2000, 2000 + REPLIES_KEPT):
        sent = len(bench.told)
        bench.commands.put(RunCommand(number, run_commands.PAUSE))
        bench.wait(lambda sent=sent: len(bench.told) > sent)  # type: ignore[misc]
    asked = len(bench.asked)
    bench.commands.put(RunCommand(first, run_commands.PAUSE))
    bench.wait(lambda: bench.told[-1].number == first)
    assert len(bench.asked) == asked + 1, "it was forgotten"


def test_a_command_without_the_key_or_from_elsewhere_is_refused(tmp_path: Path) -> None:
    secret = b"sixteen bytes and more"
    key_file = tmp_path / "key"
    key_file.write_bytes(secret)
    key_file.chmod(0o600)
    came: list[int] = []
    all_came = threading.Event()

    def on_message(message: Message, sender: object) -> None:
        came.append(RunCommand.parse(message.body).number)
        if came[-1] == 3:
            all_came.set()

    anywhere = ("127.0.0.1", 0)
    around, _ = sockets(GatewaySettings(), anywhere, ("127.0.0.1", 7511), str(key_file))
    with Link(anywhere, socket=around, on_message=on_message) as gateway:
        elsewhere = open_socket(("127.0.0.2", 0), secret=secret, sends=FROM_ROS)
        friend = open_socket(anywhere, secret=secret, sends=FROM_ROS)
        for number, socket in ((1, None), (2, elsewhere), (3, friend)):
            with Link(anywhere, socket=socket) as link:
                body = RunCommand(number, run_commands.RESET).pack()
                link.send(CONTROL, "", "", time.time_ns(), body, gateway.address)
                assert link.flush(5)
        assert all_came.wait(10)
        assert came == [3]
        refused = gateway.counters()["refused"]
        assert (refused["unsealed"], refused["stranger"]) == (1, 1)
