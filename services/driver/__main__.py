# SPDX-License-Identifier: Apache-2.0
"""Driver process, started with ``python -m services.driver``: drives a vehicle along a route."""

import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from math import radians

from groundlink.bus.core_topics import ACK, COMMAND, HEALTH
from groundlink.bus.session import Bus
from groundlink.bus.topics import driver_name
from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.routes import line
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.process.state_follower import StateFollower, follow_states
from groundlink.scenario import Scenario
from groundlink.scenario.route import Route
from groundlink.scenario.schema import Vehicle

from .driver import Driver, MakePurePursuit
from .pure_pursuit import PurePursuitFollower


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Drive until `stop` is set."""
    parser = process.parser("driver", "Drive a vehicle of a run along a route.")
    parser.add_argument("--name", required=True, help="vehicle/driver, as in rover/driver")
    parser.add_argument(
        "--route",
        metavar="FILE.yaml|FIGURE",
        help="replaces the scenario's route; a figure starts at the vehicle's present pose",
    )
    parser.add_argument("--once", action="store_true", help="end at the end of the route")
    options = parser.parse_args(arguments)
    with Bus(connect=process.endpoint(options), name=options.name) as bus:
        run, scenario = join(bus, options.run, stop)
        vehicle = _find(scenario, options.name)
        route, make_follower = _route(
            scenario, vehicle, options.route, lambda: join(bus, run, stop)[1]
        )
        if options.route and bus.present(HEALTH.key_in(run, process=options.name), seconds=1.0):
            raise UserError(f"`{vehicle.name}` already has a driver. Fix: end it first")
        finished = threading.Event()

        def say(text: str) -> None:
            print(text if sys.stdout.isatty() else f"{options.name}: {text}", flush=True)
            finished.set()

        driver = Driver(
            vehicle.name,
            make_follower,
            publish=bus.publisher(COMMAND.key_in(run, vehicle=vehicle.name), COMMAND.delivery),
            acknowledge=bus.publisher(ACK.key_in(run, process=options.name), ACK.delivery),
            say=say,
            wait_seconds=route.wait_s,
        )

        def counters() -> dict[str, int]:
            return {
                "commands": driver.commands,
                "missed_ticks": driver.missed_ticks,
                "refused": driver.refused,
            }

        def ended() -> bool:
            return stop.is_set() or (options.once and finished.is_set())

        follower = StateFollower(options.name, driver, counters)
        follow_states(bus, run, [follower], ended, waited_for=scenario.time.mode != "realtime")


def _find(scenario: Scenario, name: str) -> Vehicle:
    """Return the vehicle whose driver is called `name`."""
    for vehicle in scenario.vehicles:
        if driver_name(vehicle) == name:
            return vehicle
    known = [driver_name(vehicle) for vehicle in scenario.vehicles]
    raise UserError(f"scenario `{scenario.name}` has no `{name}`; {did_you_mean(name, known)}")


def _route(
    scenario: Scenario, vehicle: Vehicle, given: str | None, present: Callable[[], Scenario]
) -> tuple[Route, MakePurePursuit]:
    """Return the route that was given, or the scenario's, and what makes its follower.

    The scenario's route begins at the placement, so that a restarted driver finds the same line.

    Parameters
    ----------
    present
        returns the scenario of the present world: in a loaded one the placement is another.
    """
    follower = partial(
        PurePursuitFollower,
        least_radius_m=vehicle.model.least_radius_m,
        turns_radps2=vehicle.model.drive.max_angular_acceleration_radps2,
    )
    if given is not None:
        if scenario.time.mode != "realtime":
            raise UserError(
                f"run `{scenario.name}` is in {scenario.time.mode} mode, which does not wait for a "
                "driver that joins later. Fix: write `route:` into the scenario's vehicle"
            )
        from groundlink.loader.scenario_files import load_route  # loaded only where a file is read

        route = load_route(given, vehicle)
        return route, lambda x, y, yaw: follower(line(route, start_m=(x, y), heading_rad=yaw))
    if vehicle.route is None:
        raise UserError(
            f"`{vehicle.name}` has no `route` in scenario `{scenario.name}`. Fix: pass --route"
        )
    own = vehicle.route

    def along(*_: float) -> PurePursuitFollower:
        starts = {other.name: other.placement for other in present().vehicles}
        place = starts.get(vehicle.name, vehicle.placement)
        return follower(
            line(own, start_m=(place.x_m, place.y_m), heading_rad=radians(place.yaw_deg))
        )

    return own, along


if __name__ == "__main__":
    process.run("driver", main)
