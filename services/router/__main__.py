# SPDX-License-Identifier: Apache-2.0
"""Router process, started with ``python -m services.router``: connects the processes of runs.

It forwards messages and prints which processes join and leave. A `zenohd` can replace it.
"""

import argparse
import threading
from collections.abc import Sequence

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.session import Bus
from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.process import runner as process

NAME = "router"


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Forward messages until `stop` is set."""
    parser = argparse.ArgumentParser(prog=NAME, description="Connect the processes of runs.")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        default=DEFAULT_ENDPOINT,
        help="endpoint to listen on (%(default)s)",
    )
    options = parser.parse_args(arguments)
    with Bus(listen=options.listen, name=NAME) as bus:
        bus.watch(HEALTH.key_in("*", process="**"), _report)
        print(f"{NAME}: listening at {options.listen}", flush=True)
        stop.wait()


def _report(key: str, is_there: bool) -> None:
    _, run, _, process_name = key.split("/", 3)
    print(f"{NAME}: {process_name} of run `{run}` {'joined' if is_there else 'left'}", flush=True)


if __name__ == "__main__":
    process.run(NAME, main)
