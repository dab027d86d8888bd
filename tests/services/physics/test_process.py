# SPDX-License-Identifier: Apache-2.0
"""The process around the simulation: when its time begins."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import control_key, world_query_key
from groundlink.bus.session import REPLIES_KEPT
from groundlink.core.clock import NANOS
from groundlink.episode.journal import Journal, dumped
from groundlink.loader import load
from groundlink.messages.base import Ack, BusMessage, State, WheelCommand, decode, encode, floats
from groundlink.scenario.lockstep_window import HISTORY_TICKS
from groundlink.scenario.schema import Time
from services.physics.run import server as process
from services.physics.run.source import RunSource

SCENARIO = Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"


class Clocks:
    """Clocks of a machine that stand still until something takes time."""

    nanos = 7_000_000_000

    def time_ns(self) -> int:
        return 10**18 + self.nanos

    def monotonic(self) -> float:
        return self.nanos / NANOS


class SlowBus:
    """A bus on which every declaration takes 10 ms, and nobody listens."""

    def __init__(self, clocks: Clocks) -> None:
        self._clocks = clocks

    def publisher(self, *_: Any, **_options: Any) -> Callable[[BusMessage], bytes]:
        self._declare()
        return encode

    def _declare(self, *_: Any) -> None:
        self._clocks.nanos += 10_000_000

    subscribe = watch = serve = serve_content = _declare

    def hold(self) -> None: ...

    def flush(self) -> None: ...


def test_ticks_are_due_by_the_epoch_whatever_comes_before_the_first_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clocks = Clocks()
    monkeypatch.setattr(process, "time", clocks)
    bus: Any = SlowBus(clocks)
    physics = process.PhysicsServer(RunSource(load(str(SCENARIO))), "run", bus)
    clocks.nanos += 40_000_000  # until all are there that are waited for
    physics.episode.begin(clocks.time_ns(), clocks.monotonic())
    clocks.nanos += 20_000_000
    physics.close()
    wait_nanos = round(physics.episode.pacer.wait_seconds(400, clocks.monotonic()) * NANOS)
    assert clocks.time_ns() + wait_nanos - physics.episode.epoch_nanos == pytest.approx(
        NANOS, abs=10
    )
    assert clocks.time_ns() > physics.episode.epoch_nanos


class PresentBus(SlowBus):
    """A bus that tells who is there as soon as it is asked to watch."""

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        on_change(key.replace("**", "recorder"), True)


def test_present_process_is_not_awaited() -> None:
    bus: Any = PresentBus(Clocks())
    physics = process.PhysicsServer(
        RunSource(load(str(SCENARIO))), "run", bus, required=["recorder"]
    )
    physics.close()
    assert physics.missing() == []


def test_what_a_sensor_has_missed_fits_into_what_it_takes_of_one_answer() -> None:
    """Where it does not, a sensor that rejoins may wait for itself for ever; see `Bus.ask`."""
    where_it_resumes = 1
    assert where_it_resumes + HISTORY_TICKS <= REPLIES_KEPT


class TalkingBus(SlowBus):
    """A bus on which a test says something."""

    def __init__(self, clocks: Clocks) -> None:
        super().__init__(clocks)
        self._inboxes: dict[str, tuple[type[BusMessage], BusInbox[Any]]] = {}

    def subscribe(self, key: str, message_type: type[BusMessage], inbox: BusInbox[Any]) -> None:
        self._inboxes[key] = message_type, inbox

    def say(self, key: str, message: BusMessage) -> None:
        message_type, inbox = self._inboxes[key]
        inbox.put(key, encode(message), message_type)


def test_wheels_are_commanded_one_by_one_over_the_bus() -> None:
    clocks = Clocks()
    bus: Any = TalkingBus(clocks)
    scenario = load(str(SCENARIO))
    physics = process.PhysicsServer(RunSource(scenario), "run", bus)
    physics.episode.begin(clocks.time_ns(), clocks.monotonic())
    speeds = [-1.0, 2.0, -1.0, 2.0]
    names = [wheel.name for wheel in scenario.vehicles[0].model.wheels]
    key = "groundlink/run/rover/command/wheels"
    bus.say(key, WheelCommand(physics.episode.epoch_nanos, dict(zip(names, speeds, strict=True))))
    bus.say(key, WheelCommand(physics.episode.epoch_nanos, {"no_wheel": 1.0}))
    physics.receive()
    for _ in range(40):
        physics.step()
    state = physics.episode._simulation.vehicle_states()["rover"]
    physics.close()
    assert floats(state.joint_velocities) == pytest.approx(speeds, abs=0.1)
    assert physics.counters(clocks.monotonic())["refused"] == 1


@pytest.mark.parametrize(("overload", "states"), [("slow", 2), ("fail", 2), ("skip", 0)])
def test_in_real_time_a_sensor_that_was_there_resumes(overload: Any, states: int) -> None:
    clocks = Clocks()
    bus: Any = SlowBus(clocks)
    scenario = replace(load(str(SCENARIO)), time=Time(overload=overload))
    physics = process.PhysicsServer(RunSource(scenario), "run", bus)
    episode = physics.episode
    episode.begin(clocks.time_ns(), clocks.monotonic())
    for _ in range(2):
        physics.step()
    word = Ack(episode.number, 1, 1, b"what it knew")
    for name in ("rover/imu", "rover/driver", "gateway"):
        episode.acknowledged(name, word)
    episode.apply_acks()
    resume, *missed = episode.history_for("rover/imu")
    assert decode(resume, Ack) == word
    assert [decode(state, State).tick for state in missed] == list(range(3 - states, 3))
    assert [decode(known, Ack) for known in episode.history_for("gateway")] == [word]
    for late in ("rover/lidar", "rover/driver"):
        assert episode.history_for(late) == []
    physics.close()


class AskedBus(SlowBus):
    """A bus that keeps what answers queries with a payload."""

    def __init__(self, clocks: Clocks) -> None:
        super().__init__(clocks)
        self.answers: dict[str, Callable[[str, bytes], list[bytes]]] = {}

    def serve_content(self, key: str, answer: Callable[[str, bytes], list[bytes]]) -> None:
        self.answers[key] = answer


class AskedPhysics(process.PhysicsServer):
    """Physics of a fast run in the lab that is asked world queries, without its sensors."""

    def __init__(self) -> None:
        self.bus: Any = AskedBus(Clocks())
        scenario = replace(load(str(SCENARIO)), time=Time("fast"))
        super().__init__(RunSource(scenario), "run", self.bus)
        self._has_begun = True
        self.episode.begin(1, 0.0)

    def answer(self, key: str, asked: str, content: bytes) -> Any:
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(self.bus.answers[key], asked, content)
            while not waiting.done():
                self.receive()
        return msgspec.json.decode(waiting.result()[0])

    def ask(self, query: str, **fields: object) -> Any:
        content = msgspec.json.encode({"query": query, **fields})
        answer = self.answer(world_query_key("run"), "", content)
        assert "error" not in answer, answer
        return answer

    def command(self, wish: str, **fields: object) -> Any:
        asked = msgspec.json.encode({"wish": wish, **fields}).decode()
        return self.answer(control_key("run"), asked, b"")

    def entities(self) -> dict[str, Any]:
        return {entity["name"]: entity for entity in self.ask("entities")["entities"]}

    def restored(self, journal: Journal) -> None:
        """Restore a saved run."""
        self.restore(dumped(journal))
        while self._restoration is not None:
            self.step()
        assert (self.control.failure, self.control.warning) == ("", "")


def test_resets_by_scope_begin_episodes_that_keep_what_they_should() -> None:
    physics = AskedPhysics()
    ask, entities = physics.ask, physics.entities
    began, first_hash = entities(), physics.episode.world_hash
    ask("spawn", uri="person", name="tom", position_m=[0.0, 1.0, 0.0])
    ask("place", name="tom", position_m=[1.0, 1.0, 0.0])
    ask("describe", name="rover", category="object", tags=["seen"])
    physics.step()
    assert ask("reset", scopes=["time", "state"])["tick"] == physics.episode.tick == 0
    kept = entities()
    assert kept.keys() == began.keys() | {"tom"}
    assert (kept["tom"]["category"], kept["tom"]["position_m"]) == ("human", [0.0, 1.0, 0.0])
    assert kept["rover"]["tags"] == ["seen"]
    assert len(physics.episode.journal().entries) == 2, "so that a restored run knows them, too"
    ask("remove", name="tom")
    physics.step()
    assert ask("reset", scopes=["time", "state", "spawned"])["tick"] == physics.episode.tick == 0
    assert entities() == began
    assert physics.episode.world_hash == first_hash
    physics.close()


def test_a_loaded_world_is_what_a_run_is_reset_to_and_restored_in() -> None:
    physics = AskedPhysics()
    began, first, lab = physics.entities(), physics.episode.number, physics.episode.world_hash
    before = physics.episode.journal()
    physics.ask("spawn", uri="box", position_m=[0.0, 1.0, 0.0])
    physics.step()
    assert physics.ask("load_world", uri="yard")["tick"] == physics.episode.tick == 0
    yard, in_yard = physics.episode.world_hash, physics.entities()
    assert physics.control.paused
    assert physics.episode.number != first
    assert "rover" in in_yard
    assert not {"box", "room"} & in_yard.keys()
    assert physics._scenario_of(yard) == physics._scenario_of("")
    physics.ask("spawn", uri="crate", position_m=[0.0, 0.0, 0.0])
    physics.step()
    saved = physics.episode.journal()
    assert saved.scenario.world.name == "yard"
    assert (saved.in_loaded_world, before.in_loaded_world) == (True, UNSET)
    physics.ask("reset", scopes=["time", "state", "spawned"])
    assert (physics.episode.world_hash, physics.entities()) == (yard, in_yard)
    physics.ask("load_world", uri="indoor_lab")
    assert physics.entities() == began
    assert physics.episode.world_hash == lab
    physics.restored(saved)
    assert physics.entities().keys() == in_yard.keys() | {"crate"}
    physics.ask("reset", scopes=["time", "state", "spawned"])
    assert physics.entities() == in_yard, "the world of a restored run is its loaded one"
    physics.restored(before)
    assert physics.ask("world")["world"]["uri"] == "worlds/lab"
    physics.close()


def test_time_stands_still_without_a_world() -> None:
    physics = AskedPhysics()
    physics.ask("unload_world")
    physics.command("resume")
    for wish, fields in (("resume", {}), ("step", {"ticks": 5}), ("reset", {})):
        refused = physics.command(wish, **fields)
        assert (refused["error"], refused["paused"]) == ("no world is loaded. Fix: load one", True)
    assert physics.wait_seconds(0.0) > 0.0
    unloaded = physics.episode.journal()
    physics.ask("load_world", uri="worlds/lab")
    assert physics.command("resume")["paused"] is False
    physics.restored(unloaded)
    assert physics.command("resume")["paused"] is True, "a saved run without a world has none"
    physics.close()
