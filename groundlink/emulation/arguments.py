# SPDX-License-Identifier: Apache-2.0
"""Command line of the relay: one option for each direction and field of `Impairment`."""

import argparse
import re
from typing import Any

import msgspec

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError

from .script import changed
from .settings import Impairment

OPTION_PREFIXES = {"forward": "--", "back": "--back-"}
"""Option prefix of each direction."""

_FIELDS = [field.name for field in msgspec.structs.fields(Impairment) if field.type is not bool]
_HELP = {
    "loss": "share of lost datagrams, 0..1",
    "burst": "mean length of loss bursts in datagrams; 0 = independent losses",
    "duplicate": "share of duplicated datagrams",
    "reorder": "share of reordered datagrams",
    "reorder_ms": "extra delay of reordered datagrams",
    "delay_ms": "delay",
    "jitter_ms": "maximum additional delay, uniformly distributed",
    "rate_mbps": "rate limit in Mbit/s; 0 = none",
    "queue_kb": "queue of the rate limit in kilobytes",
    "bit_errors": "bit error probability",
}

Outages = list[tuple[int, int]]
"""Start and end of each outage, nanoseconds from the start of the relay."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the relay's options."""
    parser.add_argument("--listen", metavar="HOST:PORT", help="address to receive at")
    parser.add_argument("--to", metavar="HOST:PORT", help="address to relay to")
    parser.add_argument("--seed", type=int, help="random seed (0)")
    parser.add_argument(
        "--keyed",
        action="store_true",
        help="the ends share a key: deliver datagrams with bit errors",
    )
    for way, prefix in OPTION_PREFIXES.items():
        group = parser.add_argument_group(f"impairments, direction {way}")
        for field in _FIELDS:
            option = prefix + field.replace("_", "-")
            group.add_argument(option, type=float, metavar="X", help=_HELP[field])
        group.add_argument(
            f"{prefix}outage",
            action="append",
            metavar="START:LENGTH",
            help="outage in seconds; repeatable",
        )


def command_line(options: argparse.Namespace) -> list[str]:
    """Return the command line of the relay's process."""
    words = ["--keyed"] if options.keyed else []
    named = {"--listen": options.listen, "--to": options.to, "--seed": options.seed}
    for prefix in OPTION_PREFIXES.values():
        for field in _FIELDS:
            named[prefix + field.replace("_", "-")] = _value(options, prefix, field)
        for outage in _value(options, prefix, "outage") or ():
            words.append(f"{prefix}outage={outage}")
    return words + [f"{name}={value}" for name, value in named.items() if value is not None]


def impairments(options: argparse.Namespace) -> tuple[dict[str, Impairment], dict[str, Outages]]:
    """Return settings and outages of each direction.

    Raises
    ------
    UserError
        if the value of an option is invalid.
    """
    settings, outages = {}, {}
    for way, prefix in OPTION_PREFIXES.items():
        given = {field: _value(options, prefix, field) for field in _FIELDS}
        try:
            settings[way] = changed(Impairment(), {k: v for k, v in given.items() if v is not None})
        except ValueError as error:
            field = str(error).partition(": ")[0].strip("`")
            if field not in given:  # about several fields
                raise UserError(f"direction {way}: {error}") from None
            problem = str(error).removeprefix(f"`{field}`: ")
            option = prefix + field.replace("_", "-")
            raise UserError(f"{option} {given[field]:g}: {problem}") from None
        outages[way] = [_outage(prefix, text) for text in _value(options, prefix, "outage") or ()]
    return settings, outages


def _value(options: argparse.Namespace, prefix: str, field: str) -> Any:
    return getattr(options, prefix[2:].replace("-", "_") + field)


def _outage(prefix: str, text: str) -> tuple[int, int]:
    if not re.fullmatch(r"\d+(\.\d+)?:\d+(\.\d+)?", text):
        raise UserError(f"{prefix}outage {text}: expected START:LENGTH in seconds, such as 10:2")
    start, length = (round(float(part) * NANOS) for part in text.split(":"))
    return start, start + length
