# SPDX-License-Identifier: Apache-2.0
"""Start all sensors of a run in one process: ``python -m services.sensors``.

Each sensor has its own readings, progress and health, as in a process of its own. A state is taken
off the bus once and passed to one sensor after the other, so the sensors wait for each other.
"""

import threading
from collections.abc import Sequence
from contextlib import ExitStack

from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.process import runner as process
from groundlink.process.joining import join_world
from groundlink.process.memory import keep_memory
from groundlink.process.state_follower import follow_states
from services.sensors.runtime.process import follower


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run all sensors until `stop` is set."""
    parser = process.parser("sensors", "Simulate the sensors of a run, all in this process.")
    parser.add_argument(
        "--name",
        metavar="VEHICLE/SENSOR",
        action="append",
        help="this sensor and not all of the scenario; repeatable",
    )
    options = parser.parse_args(arguments)
    with ExitStack() as opened:
        bus = opened.enter_context(Bus(connect=process.endpoint(options)))
        run_name, scenario = join_world(bus, options.run, stop)
        sensors = [
            follower(name, scenario, bus, run_name, opened)
            for name in dict.fromkeys(options.name or scenario.sensor_names())
        ]
        if not sensors:
            raise UserError(f"scenario `{scenario.name}` has no sensors")
        keep_memory()
        follow_states(
            bus, run_name, sensors, stop.is_set, waited_for=scenario.time.mode != "realtime"
        )


if __name__ == "__main__":
    process.run("sensors", main)
