# SPDX-License-Identifier: Apache-2.0
"""What a driver says to the run, and when."""

import numpy as np

from groundlink.core.clock import TICK_NANOS
from groundlink.episode.routes import Line
from groundlink.messages.base import Ack, Command, State, VehicleState, packed
from groundlink.scenario.route import COMMAND_AHEAD_TICKS, DRIVER_PERIOD_TICKS
from services.driver.driver import Driver
from services.driver.pure_pursuit import PurePursuitFollower

EPOCH = 1000


def state(tick: int, x_m: float = 0.0, *, epoch: int = EPOCH, name: str = "rover") -> State:
    pose = np.array([x_m, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0])
    nothing = packed(np.zeros(6))
    vehicle = VehicleState(packed(pose), nothing, packed(np.zeros(4)), packed(np.zeros(4)))
    return State("run", epoch, epoch, tick, tick * TICK_NANOS, "hash", {name: vehicle})


class Rover:
    """A driver and all that it said, in order."""

    def __init__(self, *, wait_seconds: float = 0.0) -> None:
        self.said: list[object] = []
        self.made = 0
        self.driver = Driver(
            "rover",
            self._make,
            publish=self.said.append,
            acknowledge=self.said.append,
            say=self.said.append,
            wait_seconds=wait_seconds,
        )

    def _make(self, x_m: float, y_m: float, yaw_rad: float) -> PurePursuitFollower:
        self.made += 1
        return PurePursuitFollower(Line(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([0.5])))

    def commands(self) -> list[Command]:
        return [said for said in self.said if isinstance(said, Command)]

    def acks(self) -> list[int]:
        return [said.tick for said in self.said if isinstance(said, Ack)]


def test_a_command_is_stamped_ahead_and_goes_before_its_acknowledgement() -> None:
    rover = Rover()
    for tick in range(20):
        rover.driver.take(state(tick))
    assert rover.acks() == [0, DRIVER_PERIOD_TICKS, 2 * DRIVER_PERIOD_TICKS]
    stamps = [EPOCH + (tick + COMMAND_AHEAD_TICKS) * TICK_NANOS for tick in rover.acks()]
    assert [command.stamp_nanos for command in rover.commands()] == stamps
    assert [type(said) for said in rover.said[:4]] == [Command, Ack, Command, Ack]
    assert rover.commands()[0].linear_mps[0] == 0.5


def test_driver_stops_at_the_end_reports_once_and_releases_the_vehicle() -> None:
    rover = Rover()
    for tick in range(0, 80, 8):
        rover.driver.take(state(tick, 1.0 if tick < 40 else 2.1))
    assert rover.commands()[-1].linear_mps[0] == 0.0
    assert len(rover.commands()) == 6
    assert [said for said in rover.said if isinstance(said, str)] == [
        "the route is driven; stopped at 0.1 s"
    ]
    assert rover.acks()[-1] == 72, "physics still waits for it"


def test_driver_waits_at_the_start_of_the_route() -> None:
    rover = Rover(wait_seconds=0.1)
    for tick in range(400, 480):
        rover.driver.take(state(tick))
    speeds = [command.linear_mps[0] for command in rover.commands()]
    assert speeds == [0.0] * 5 + [0.5] * 5, "0.1 s of 50 commands a second"


def test_a_successor_stands_still_for_the_rest_of_the_wait_only() -> None:
    first, second = Rover(wait_seconds=0.1), Rover(wait_seconds=0.1)
    for tick in range(400, 420):
        first.driver.take(state(tick))
    [*_, ack] = [said for said in first.said if isinstance(said, Ack)]
    second.driver.resume(ack)
    for tick in range(420, 480):
        second.driver.take(state(tick))
    assert [c.linear_mps[0] for c in second.commands()] == [0.0] * 2 + [0.5] * 5


def test_a_lost_state_is_made_up_for_by_the_next() -> None:
    rover = Rover()
    for tick in (0, 7, 9, 10, 16):
        rover.driver.take(state(tick))
    assert rover.acks() == [0, 9, 16]
    assert rover.driver.missed_ticks == 12


def test_a_successor_answers_nothing_twice_and_goes_on_as_its_predecessor_would() -> None:
    """Also where the nearest point of the line is not where the predecessor was."""
    alone, first, second = Rover(), Rover(), Rover()
    drive = [state(tick, 0.1 * tick) for tick in range(0, 65, 8)]
    for each in drive:
        alone.driver.take(each)
    for each in drive[:3]:
        first.driver.take(each)
    ack = first.said[-1]
    assert isinstance(ack, Ack)
    second.driver.resume(ack)
    for each in drive[1:]:
        second.driver.take(each)
    assert second.acks() == [16, 24, 32, 40, 48, 56, 64]
    assert first.said + second.said[1:] == alone.said
    assert second.made == 1


def test_the_first_acknowledgement_grants_no_step_that_needs_a_command() -> None:
    rover = Rover()
    rover.driver.resume(Ack(EPOCH, -1, -1))
    rover.driver.take(state(0))
    assert rover.acks() == [-DRIVER_PERIOD_TICKS, 0]
    assert len(rover.commands()) == 1


def test_a_new_episode_starts_the_route_again() -> None:
    rover = Rover()
    rover.driver.take(state(800))
    rover.driver.take(state(0, epoch=EPOCH + 1))
    assert rover.made == 2
    assert rover.acks() == [800, 0]


def test_a_state_without_the_vehicle_is_counted() -> None:
    rover = Rover()
    rover.driver.take(state(0, name="other"))
    assert rover.driver.refused == 1
    assert rover.said == []
