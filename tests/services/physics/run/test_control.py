# SPDX-License-Identifier: Apache-2.0
"""Run commands are executed between two ticks, and their sender gets an answer."""

import threading

import msgspec
import pytest

from groundlink.core.errors import UserError
from groundlink.episode.control import (
    AnyRunCommand,
    ControlAnswer,
    Pause,
    Remove,
    Reset,
    Restore,
    Resume,
    Spawn,
    Step,
)
from groundlink.loader.additions import KINDS
from services.physics.run import control as module
from services.physics.run.control import Control


class Loop:
    """A run that steps whenever it may."""

    def __init__(self) -> None:
        self.episodes = 1
        self.spawned: list[str] = []
        self.restored: list[bytes] = []
        self.control = Control(self)
        self.control.stepped(0)

    def reset(self) -> None:
        self.episodes += 1
        self.control.stepped(0)

    def change(self, command: Spawn | Remove) -> None:
        if isinstance(command, Remove):
            raise UserError(f"there is no `{command.name}`")
        self.spawned += command.more.names()

    def restore(self, content: bytes) -> None:
        self.restored.append(content)

    def refuse_without_world(self) -> None:
        """Refuse nothing: there is a world."""

    def turn(self, times: int = 1) -> None:
        for _ in range(times):
            self.control.execute_pending()
            if not self.control.paused:
                self.control.stepped(self.control.tick + 1)

    def asked(self, text: str, content: bytes = b"") -> ControlAnswer:
        answers: list[bytes] = []
        query_thread = threading.Thread(
            target=lambda: answers.extend(self.control.answer(text, content))
        )
        query_thread.start()
        while query_thread.is_alive():
            self.control.execute_pending()
            query_thread.join(0.001)
        return msgspec.json.decode(answers[0], type=ControlAnswer)

    def commanded(self, command: AnyRunCommand, content: bytes = b"") -> ControlAnswer:
        return self.asked(msgspec.json.encode(command).decode(), content)


def test_time_stands_while_paused_and_goes_on() -> None:
    loop = Loop()
    loop.turn(10)
    assert loop.commanded(Pause()) == ControlAnswer("", 10, True)
    loop.turn(10)
    assert loop.asked("") == ControlAnswer("", 10, True)
    loop.commanded(Step(3))
    loop.turn(10)
    assert loop.asked("") == ControlAnswer("", 13, True)
    assert loop.commanded(Resume()) == ControlAnswer("", 13, False)
    loop.turn(10)
    assert loop.asked("") == ControlAnswer("", 23, False)


def test_steps_of_a_running_run_end_in_a_pause() -> None:
    loop = Loop()
    loop.commanded(Step(2))
    loop.turn(5)
    assert loop.asked("") == ControlAnswer("", 2, True)


@pytest.mark.parametrize("command", [Pause(), Resume()])
def test_a_run_that_begins_again_stands_or_goes_as_before(command: AnyRunCommand) -> None:
    loop = Loop()
    loop.commanded(command)
    loop.turn(5)
    assert loop.commanded(Reset()) == ControlAnswer("", 0, command == Pause())
    assert loop.episodes == 2


@pytest.mark.parametrize("text", ["{", "{}", '{"wish":"dance"}', '{"wish":"step","ticks":0}'])
def test_an_invalid_command_is_refused_with_a_reason(text: str) -> None:
    loop = Loop()
    assert loop.asked(text).error
    loop.turn(3)
    assert loop.asked("") == ControlAnswer("", 3, False)


def test_busy_run_refuses_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ANSWER_SECONDS", 0.01)
    (answer,) = Loop().control.answer('{"wish":"pause"}')
    assert "busy" in msgspec.json.decode(answer, type=ControlAnswer).error


def test_world_changes_between_ticks_or_gives_a_reason() -> None:
    loop = Loop()
    loop.turn(5)
    assert loop.commanded(Spawn(KINDS["box"])) == ControlAnswer("", 5, False)
    assert loop.spawned == ["box"]
    assert loop.commanded(Remove("ball")) == ControlAnswer("there is no `ball`", 5, False)
    loop.turn()
    assert loop.control.tick == 6


def test_what_is_to_be_restored_comes_with_the_command() -> None:
    loop = Loop()
    assert not loop.commanded(Restore(), b"a file").error
    assert loop.restored == [b"a file"]


@pytest.mark.parametrize("command", [Reset(), Restore(), Remove("ball"), Spawn(KINDS["box"])])
def test_nothing_changes_a_run_while_it_is_restored(command: AnyRunCommand) -> None:
    loop = Loop()
    loop.control.restoring_to, loop.control.tick = 800, 200
    answer = loop.commanded(command)
    assert answer.error == (
        "the run is being restored, at tick 200 of 800. Fix: wait until that is done"
    )
    assert (loop.episodes, loop.spawned, loop.restored) == (1, [], [])
    assert loop.commanded(Pause()) == ControlAnswer("", 200, True, restoring_to=800)
