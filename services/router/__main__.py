# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.router``: where the processes of runs on several machines meet.

Rule: it carries what others say, and says itself only who comes and goes. A zenohd does as well.
"""

from __future__ import annotations

import argparse
import threading
from collections.abc import Sequence

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.session import DEFAULT_ENDPOINT, Bus
from groundlink.process import runner as process

NAME = "router"


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Carry until `stop` is set."""
    parser = argparse.ArgumentParser(prog=NAME, description="Join the processes of runs.")
    parser.add_argument(
        "--listen", metavar="ENDPOINT", default=DEFAULT_ENDPOINT, help="where (%(default)s)"
    )
    options = parser.parse_args(arguments)
    with Bus(listen=options.listen, name=NAME) as bus:
        bus.watch(HEALTH.key_in("*", process="**"), _tell)
        print(f"{NAME}: listens at {options.listen}", flush=True)
        stop.wait()


def _tell(key: str, there: bool) -> None:
    _, run, _, process_name = key.split("/", 3)
    print(f"{NAME}: {process_name} of run `{run}` {'came' if there else 'went'}", flush=True)


if __name__ == "__main__":
    process.run(NAME, main)
