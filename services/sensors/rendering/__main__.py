# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.rendering --name VEHICLE/SENSOR --at S --out DIR``.

The process joins a run like the camera itself, takes one picture, writes files, and ends.
`groundlink snapshot` starts the run around it. OpenGL packages are imported after a check that they
are installed.
"""

import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from groundlink.bus.core_topics import ACK
from groundlink.bus.session import Bus
from groundlink.core.clock import NANOS, exact
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.process import runner as process
from groundlink.process.joining import join_world
from groundlink.process.state_follower import StateFollower, follow_states
from groundlink.scenario.cameras import Optics
from groundlink.scene.build import world_hash
from services.sensors.runtime.process import find_ruts
from services.sensors.runtime.runner import SensorProcess

PROCESS = "sensors.rendering"


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Write the view of a camera at one instant of a run."""
    parser = process.parser(PROCESS, "Write what a camera sees at one instant of a run.")
    parser.add_argument("--name", required=True, help="vehicle/sensor, as in rover/camera")
    parser.add_argument("--at", type=float, required=True, metavar="S", help="sim time")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    options = parser.parse_args(arguments)
    with needs("camera"):
        import moderngl  # noqa: F401  (the renderer imports it when it draws)

        from services.sensors.rendering.portrait.snapshot import Snapshot, write

    with Bus(connect=process.endpoint(options)) as bus:
        run, scenario = join_world(bus, options.run, stop)
        vehicle, spec = scenario.sensor(options.name) or (None, None)
        if vehicle is None or not isinstance(spec, Optics):
            raise UserError(f"scenario `{scenario.name}` has no camera `{options.name}`")
        snapshot = Snapshot(scenario, vehicle, spec, int(exact(options.at) * NANOS))
        taker = SensorProcess(
            snapshot,
            expected_world_hash=world_hash(scenario),
            ack_ticks=scenario.time.ack_ticks,
            publish=lambda _: None,
            acknowledge=bus.publisher(ACK.key_in(run, process=options.name), ACK.delivery),
            ruts=partial(find_ruts, bus, run),
        )

        def ended() -> bool:
            return stop.is_set() or snapshot.frame is not None

        follower = StateFollower(options.name, taker, lambda: {"refused": taker.refused})
        follow_states(bus, run, [follower], ended)
    if snapshot.frame is not None:
        prefix = f"{options.name.replace('/', '_')}_{options.at:g}s"
        for file in write(options.out, prefix, snapshot.frame, snapshot.labels):
            print(file)


if __name__ == "__main__":
    process.run(PROCESS, main)
