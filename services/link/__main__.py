# SPDX-License-Identifier: Apache-2.0
"""Link process, started with ``groundlink link``: relays UDP over an emulated link."""

import argparse
import json
import threading
import time
from collections.abc import Sequence
from typing import NoReturn

from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.emulation.arguments import Outages, add_arguments, impairments
from groundlink.emulation.model import NOTES, OUTCOMES
from groundlink.process import runner as process

from .relay import UdpRelay

NAME = "link"


class _Parser(argparse.ArgumentParser):
    """Parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Relay until `stop` is set, then print the counters."""
    parser = _Parser(prog=NAME, description="Relay UDP datagrams over an emulated link.")
    add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the counters as JSON")
    options = parser.parse_args(arguments)
    if options.listen is None or options.to is None:
        raise UserError("expected --listen HOST:PORT and --to HOST:PORT")
    settings, outages = impairments(options)
    seed = options.seed or 0
    if seed < 0:
        raise UserError(f"--seed {seed}: expected 0 or more")
    relay = UdpRelay(
        process.address(options.listen),
        process.address(options.to),
        forward=settings["forward"],
        back=settings["back"],
        seed=seed,
        flips=options.keyed,
    )
    host, port = relay.address
    print(f"relaying from {host}:{port} to {options.to}", flush=True)
    start_nanos = time.monotonic_ns()
    try:
        while not stop.is_set():
            now = time.monotonic_ns() - start_nanos
            for name, direction in relay.directions.items():
                is_out = _is_out(outages[name], now)
                if direction.settings.outage != is_out:
                    direction.settings = replace(direction.settings, outage=is_out)
            relay.turn(time.monotonic_ns)
    finally:
        relay.close()
        _print_counters(relay, as_json=options.json)


def _is_out(outages: Outages, now: int) -> bool:
    return any(start <= now < end for start, end in outages)


def _print_counters(relay: UdpRelay, *, as_json: bool) -> None:
    """Print the counters; those of each direction add up."""
    directions = {
        name: {**each.counts, "waiting": each.waiting} for name, each in relay.directions.items()
    }
    rest = {"peers": relay.peers, "kernel_drops": relay.kernel_drops, "unsent": relay.unsent}
    if as_json:
        print(json.dumps(directions | rest), flush=True)
        return
    for name, counts in directions.items():
        outcomes = ", ".join(
            f"{outcome} {counts[outcome]}" for outcome in (*OUTCOMES, "waiting") if counts[outcome]
        )
        notes = ", ".join(f"{note} {counts[note]}" for note in NOTES if counts[note])
        print(
            f"{name}: datagrams {counts['datagrams']} + duplicated {counts['duplicated']} = "
            f"{outcomes or 'none'}" + (f" (of these {notes})" if notes else "")
        )
    print(", ".join(f"{name} {count}" for name, count in rest.items()), flush=True)


if __name__ == "__main__":
    process.run(NAME, main)
