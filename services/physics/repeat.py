# SPDX-License-Identifier: Apache-2.0
"""First process of a pipeline, ``python -m services.physics.repeat``: repeats a journal.

Steps the world of a saved run through its journal and writes what physics publishes to standard
output (`groundlink.bus.pipe`), as fast as the next process reads.
"""

import argparse
import threading
from collections.abc import Sequence

import msgspec

from groundlink.bus.core_topics import PHYSICS
from groundlink.bus.pipe import PipeBus, standard_streams
from groundlink.bus.queries import scenario_key
from groundlink.core.extras import process_needs
from groundlink.process import runner as process

with process_needs(PHYSICS, "physics"):
    from services.physics.run.episode import Episode
    from services.physics.run.publishers import BusPublishers
    from services.physics.run.restore import JournalPlayer
    from services.physics.run.source import add_arguments, source_of


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Write the messages of each tick until `stop` is set, or until the given tick."""
    parser = argparse.ArgumentParser(prog=PHYSICS, description="Repeat a saved run into a pipe.")
    add_arguments(parser)
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--until", type=int, metavar="TICK", help="last tick (default: none)")
    options = parser.parse_args(arguments)
    source = source_of(options)
    followed = source.followed
    assert followed is not None, "started with --follow"
    _, out = standard_streams()
    bus = PipeBus(out)
    publishers = BusPublishers(bus, options.run, source.scenario)
    episode = Episode(
        *(source.scenario, options.run, publishers),
        required=(),
        wall_nanos=0,
        epoch_nanos=followed.epoch_nanos,
    )
    player, known_world = JournalPlayer(followed), episode.world_hash
    bus.write(scenario_key(options.run), msgspec.msgpack.encode(episode.scenario))
    episode.begin(0, 0.0)
    while not stop.is_set() and episode.tick != options.until:
        player.play(episode)
        if episode.world_hash != known_world:
            known_world = episode.world_hash
            publishers.declare(episode.scenario)
            bus.write(scenario_key(options.run), msgspec.msgpack.encode(episode.scenario))
        episode.step()
    bus.close()


if __name__ == "__main__":
    process.run(PHYSICS, main)
