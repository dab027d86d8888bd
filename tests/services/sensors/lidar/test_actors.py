# SPDX-License-Identifier: Apache-2.0
"""A LiDAR sees actors where their motion has them at each ray's own instant."""

from collections.abc import Iterator

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import BadBusMessage, PointCloud, State, packed
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.scene.bodies import link_bodies
from groundlink.world.actor_motion import mover
from groundlink.world.actors import Actor, PartsForm, PathMotion
from groundlink.world.solids import Box, Solid
from services.sensors.rays.replica import Replica

from . import rooms

SPEED_MPS = 10.0
BOARD = Solid("board", Box(size_m=(0.2, 3.0, 1.2)), "dark", (0.0, 0.0, 0.6))
MOTION = PathMotion(points_m=((4.5, 0.0), (-4.5, 0.0)), speed_mps=SPEED_MPS)
TICKS = 160


def room(*actors: Actor) -> Scenario:
    made = rooms.scenario()
    return replace(made, world=replace(made.world, actors=actors))


def board(motion: PathMotion = MOTION) -> Actor:
    return Actor(name="board", form=PartsForm(parts=(BOARD,)), motion=motion)


def told(made: Scenario) -> Iterator[State]:
    """Yield states in which the sensor stands and every actor is where its motion says."""
    movers = [mover(actor.motion, None) for actor in made.world.actors]  # type: ignore[arg-type]
    for state in rooms.states(made, lambda _: ((-4.0, 0.0, 0.6), (0.0, 0.0, 0.0)), TICKS):
        places = [made_of.at(state.tick * TICK_SECONDS) for made_of in movers]
        rows = np.array([[*place.position_m, *place.orientation] for place in places])
        yield replace(state, actors=packed(rows))


def clouds(made: Scenario) -> list[PointCloud]:
    sensor = rooms.model(made)
    return [cloud for state in told(made) for cloud in sensor.readings(state)]


def test_a_moving_board_is_met_where_it_is_at_each_rays_time() -> None:
    met, seconds = [], []
    for cloud in clouds(room(board())):
        x, y, z = np.add(rooms.points(cloud), (-4.0, 0.0, 0.6)).T
        front_m = 4.5 - SPEED_MPS * rooms.sim_seconds(cloud) - 0.1
        on_it = (np.abs(y) < 1.3) & (z < 1.1) & (z > 0.1) & (x > -3.0)
        met += (x - front_m)[on_it].tolist()
        seconds += rooms.sim_seconds(cloud)[on_it].tolist()
    assert len(met) > 200
    assert np.ptp(seconds) > 0.25
    # It moves by half a meter while the beam sweeps over it.
    assert np.abs(met).max() < 1e-3


def test_a_body_of_a_state_that_lacks_actors_is_refused() -> None:
    made = room(board())
    replica = Replica(made, made.vehicles[0], Mount((0.0, 0.0, 0.5)))
    (state,) = rooms.states(made, rooms.at_rest, 1)
    with pytest.raises(BadBusMessage, match="1 link poses of `actors`"):
        replica.take(state)


def test_actors_are_numbered_after_all_links() -> None:
    made = room(board())
    replica = Replica(made, made.vehicles[0], Mount((0.0, 0.0, 0.5)))
    links = link_bodies(made)
    assert links[-1] == replica.movers[-1] == "board"
    assert len(links) == len(replica.links)
    for state in told(made):
        replica.take(state)
    replica.scene.move(replica.motion(0, 1))
    down = np.array([[0], [0], [-1]], np.float32)
    hits = replica.scene.cast(
        np.array([[4.5], [0], [2.0]], np.float32), down, np.zeros(1, np.float32), 10.0
    )
    numbers = replica.body_numbers(hits.label, hits.body)
    assert links[int(numbers[0])] == "board"
    assert float(hits.range_m[0]) == pytest.approx(0.8, abs=1e-5)
