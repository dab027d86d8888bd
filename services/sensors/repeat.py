# SPDX-License-Identifier: Apache-2.0
"""Process of a pipeline, ``python -m services.sensors.repeat``: sensors that follow a pipe.

Reads the messages of a repeated run from standard input (`groundlink.bus.pipe`), passes them on and
adds what its sensors publish. A sensor behaves as on the bus, since the same code runs it.
"""

import argparse
import threading
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from groundlink.bus.core_topics import STATE
from groundlink.bus.pipe import PipeBus, read_piped, standard_streams
from groundlink.bus.queries import scenario_key
from groundlink.episode import journal
from groundlink.messages.base import State, decode
from groundlink.process import runner as process
from groundlink.scenario.decoding import decode_scenario
from groundlink.scene.build import world_hash
from services.sensors.runtime.process import follower


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Follow the states until the input ends."""
    parser = argparse.ArgumentParser(
        prog="sensors", description="Simulate sensors of a repeated run in a pipeline."
    )
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument(
        "--name", action="append", required=True, metavar="VEHICLE/SENSOR", help="repeatable"
    )
    parser.add_argument(
        "--follow", required=True, metavar="FILE", help="saved run with the scenario of the sensors"
    )
    options = parser.parse_args(arguments)
    scenario = journal.loaded(journal.read(Path(options.follow)), options.follow).scenario
    source, out = standard_streams()
    world, states = scenario_key(options.run), STATE.key_in(options.run)
    with ExitStack() as opened:
        bus = opened.enter_context(closing(PipeBus(out)))
        sensors = [follower(name, scenario, bus, options.run, opened) for name in options.name]
        for key, payload in read_piped(source):
            if key == states:
                state = decode(payload, State)
                for sensor in sensors:
                    sensor.consumer.take(state)
            elif key == world:
                bus.answers[key, world_hash(decode_scenario(payload))] = payload
            bus.write(key, payload)


if __name__ == "__main__":
    process.run("sensors", main)
