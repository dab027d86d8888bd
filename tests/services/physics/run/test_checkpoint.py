# SPDX-License-Identifier: Apache-2.0
"""An episode that begins at a checkpoint publishes what the episode did that made it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.episode.checkpoint import Checkpoint, dumped, loaded
from groundlink.episode.control import Remove, Spawn
from groundlink.episode.journal import acting_since
from groundlink.loader import load
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages.base import Ack, BusMessage, Command, State, decode, encode
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import TrueMap
from groundlink.scenario.schema import Placement
from groundlink.world.actors import (
    Actor,
    CrateForm,
    DoorForm,
    EntityDescription,
    FreeMotion,
    HingeMotion,
    Swing,
)
from groundlink.world.solids import Material
from services.physics.run.episode import Episode
from services.physics.run.publishers import Publish, Publishers
from tests.services.physics.grounds import SOILS, shipped
from tests.services.physics.terrains import terrain, world

PERIOD_S = 0.5
PERIOD_TICKS = 200
END_TICK = 700

CRATES = tuple(
    Actor(
        name=f"crate_{i}",
        form=CrateForm(material="cardboard"),
        motion=FreeMotion(at_m=(1.0, 0.0, 0.4 * i), mass_kg=8.0),
    )
    for i in range(2)
)
DOOR = Actor(
    name="gate",
    form=DoorForm(material="wood", width_m=1.4),
    motion=HingeMotion(
        at_m=(1.8, -0.7, 0.0), yaw_deg=90.0, swings=(Swing(at_s=0.9, angle_deg=95.0),)
    ),
)


def of_rover() -> Scenario:
    """Return a rover that meets actors."""
    lab = load("indoor_lab")
    return replace(
        lab,
        vehicles=(replace(lab.vehicles[0], placement=Placement()),),
        world=replace(lab.world, actors=(*CRATES, DOOR)),
        true_map=TrueMap(resolution_m=0.1, rate_hz=7.0),
    )


def of_robot() -> Scenario:
    """Return a robot that meets walls."""
    paper = load("indoor_paper")
    return replace(paper, vehicles=(replace(paper.vehicles[0], placement=Placement()),))


def of_tank() -> Scenario:
    """Return a tank on hills."""
    return load("outdoor_paper")


def of_soft_ground() -> Scenario:
    """Return a rover that leaves ruts."""
    soft = {"ground": Material(soil=SOILS["lete_sand"])}
    return world(terrain(np.zeros((21, 21))), (shipped("rover"), Placement()), materials=soft)


class Heard:
    """Publishers that keep all that an episode publishes, by the tick after which it does."""

    def __init__(self, scenario: Scenario) -> None:
        self.messages: list[tuple[int, bytes]] = []
        self.tick = 0
        each: dict[str, Publish] = {vehicle.name: self for vehicle in scenario.vehicles}
        self.publishers = Publishers(self, self, self, self, each, each, each, each)

    def __call__(self, message: BusMessage) -> bytes:
        plain = replace(message, episode=0) if hasattr(message, "episode") else message
        self.messages.append((self.tick, encode(plain)))
        return encode(message)

    def after(self, tick: int) -> list[bytes]:
        return [message for at, message in self.messages if at > tick]


@contextmanager
def episode_of(
    scenario: Scenario, heard: Heard, number: int, checkpoint: Checkpoint | None = None
) -> Iterator[Episode]:
    episode = Episode(
        *(scenario, "run", heard.publishers),
        required=(),
        wall_nanos=number,
        checkpoint=checkpoint,
    )
    episode.begin(number, 0.0)
    yield episode
    episode.end()


def change(episode: Episode, vehicle: str) -> None:
    """Give commands, and change the world between checkpoints."""
    tick = episode.tick
    if tick % 8 == 0:
        stamp = episode.epoch_nanos + (tick + 9) * TICK_NANOS
        turn = 0.7 if tick % 400 < 200 else -0.5
        episode.command(vehicle, Command(stamp, (1.5, 0.0, 0.0), (0.0, 0.0, turn)))
    if tick == 430:
        place = SpawnPlace(-3.0, -2.0)
        episode.change(Spawn(addition("crate", at=place, name=None, taken=(), ground=None)[1]))
    if tick == 440:
        episode.describe("crate", EntityDescription(description="heavy"))
    if tick == 620:
        episode.change(Remove("crate"))
    if tick == 650:
        episode.reset_state()


@pytest.mark.parametrize("made", [of_rover, of_robot, of_tank, of_soft_ground])
def test_equals_the_episode_that_made_it(made: Callable[[], Scenario]) -> None:
    scenario = made()
    time = replace(scenario.time, mode="fast", checkpoint_s=PERIOD_S)
    scenario = replace(scenario, time=time)
    vehicle = scenario.vehicles[0].name
    heard = Heard(scenario)
    with episode_of(scenario, heard, 5) as episode:
        while episode.tick < END_TICK:
            change(episode, vehicle)
            heard.tick = episode.tick + 1
            episode.step()
        checkpoints, journal = episode.checkpoints.complete, episode.journal()
        registry = episode.entities.memory()
    assert registry.descriptions
    sent = (decode(m, State) for _, m in heard.messages if b"vehicles" in m)
    assert any(state.ruts for state in sent) == (made is of_soft_ground)
    assert [checkpoint.tick for checkpoint in checkpoints] == [
        *range(PERIOD_TICKS, END_TICK, PERIOD_TICKS)
    ]
    for checkpoint in checkpoints:
        checkpoint = loaded(dumped(checkpoint), "file")
        again = Heard(scenario)
        again.tick = checkpoint.tick
        with episode_of(scenario, again, 9, checkpoint) as episode:
            entries = list(acting_since(checkpoint.tick, journal.entries))
            while episode.tick < END_TICK:
                while entries and entries[0].tick <= episode.tick:
                    episode.replay(entries.pop(0))
                again.tick = episode.tick + 1
                episode.step()
            assert again.after(checkpoint.tick) == heard.after(checkpoint.tick)
            # Messages of the tick itself, without those that are due before the checkpoint only.
            first = [message for tick, message in again.messages if tick == checkpoint.tick]
            assert set(first) <= {m for tick, m in heard.messages if tick == checkpoint.tick}
            assert episode.journal().checkpoint == checkpoint
            assert episode.entities.memory() == registry


def test_checkpoints_change_nothing_before_the_first() -> None:
    scenario = of_robot()
    plain, heard = Heard(scenario), Heard(scenario)
    with_checkpoints = replace(scenario, time=replace(scenario.time, checkpoint_s=PERIOD_S))
    for each, of, number in ((scenario, plain, 5), (with_checkpoints, heard, 5)):
        with episode_of(each, of, number) as episode:
            while episode.tick < PERIOD_TICKS - 1:
                change(episode, each.vehicles[0].name)
                episode.step()
    states = [m for _, m in plain.messages]
    assert [m for _, m in heard.messages] == states


def test_last_acknowledgement_of_a_driver_needs_no_earlier_command() -> None:
    """It refers to a command before the checkpoint, which the episode never gets."""
    scenario = of_robot()
    scenario = replace(scenario, time=replace(scenario.time, mode="fast", checkpoint_s=PERIOD_S))
    with episode_of(scenario, Heard(scenario), 5) as episode:
        while episode.tick < PERIOD_TICKS:
            episode.step()
        [checkpoint] = episode.checkpoints.complete
    name = f"{scenario.vehicles[0].name}/driver"
    ack = Ack(9, PERIOD_TICKS, PERIOD_TICKS, commanded={scenario.vehicles[0].name: 50})
    with episode_of(scenario, Heard(scenario), 9, checkpoint) as episode:
        episode.take_over({name: replace(ack, episode=5)})
        ack = replace(ack, tick=PERIOD_TICKS + 8)
        episode.acknowledged(name, ack)
        episode.apply_acks()
        assert episode.journal().acks[name] == ack
        state = decode(episode.history_for(name)[1], State)
        assert state.tick == PERIOD_TICKS


def test_of_another_model_is_refused() -> None:
    robot, tank = of_robot(), of_tank()
    robot = replace(robot, time=replace(robot.time, checkpoint_s=PERIOD_S))
    with episode_of(robot, Heard(robot), 5) as episode:
        while episode.tick < PERIOD_TICKS:
            episode.step()
        [checkpoint] = episode.checkpoints.complete
    other = replace(tank.vehicles[0], name=robot.vehicles[0].name, placement=Placement())
    materials = robot.world.materials | tank.world.materials
    world = replace(robot.world, materials=materials)
    with_tank = replace(robot, vehicles=(other,), world=world)
    for bad, problem in (
        (checkpoint, "wheels, got"),
        (replace(checkpoint, memory=b"?"), "MessagePack|Expected"),
    ):
        with pytest.raises((ValueError, msgspec.MsgspecError), match=problem):
            Episode(
                *(with_tank, "run", Heard(with_tank).publishers),
                required=(),
                wall_nanos=9,
                checkpoint=bad,
            )
