# SPDX-License-Identifier: Apache-2.0
"""The relay's command line: one option for each field of `Impairment` and direction.

Rule: options are derived from the fields, so that scenario and command line use the same words.
"""

from __future__ import annotations

import argparse
import re
from typing import Any

import msgspec

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError

from .script import changed
from .settings import Impairment

WAYS = {"forward": "--", "back": "--back-"}
"""By direction: how its options begin."""

_FIELDS = [field.name for field in msgspec.structs.fields(Impairment) if field.type is not bool]
_HELP = {
    "loss": "share of datagrams lost, 0..1",
    "burst": "mean number lost in a row; 0 = each on its own",
    "duplicate": "share that arrives twice",
    "reorder": "share that is overtaken",
    "reorder_ms": "how long those are held up",
    "delay_ms": "time on the way",
    "jitter_ms": "at most this much more",
    "rate_mbps": "megabits a second; 0 = no limit",
    "queue_kb": "kilobytes that may wait for the rate",
    "bit_errors": "probability of an error in each bit",
}

Outages = list[tuple[int, int]]
"""Begin and end of each, nanoseconds from the start."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the relay's options."""
    parser.add_argument("--listen", metavar="HOST:PORT", help="where senders send to")
    parser.add_argument("--to", metavar="HOST:PORT", help="where it goes from here")
    parser.add_argument("--seed", type=int, help="of what is random (0)")
    parser.add_argument(
        "--keyed", action="store_true", help="the ends share a key: deliver bit errors"
    )
    for way, prefix in WAYS.items():
        group = parser.add_argument_group(f"what happens on the way {way}")
        for field in _FIELDS:
            option = prefix + field.replace("_", "-")
            group.add_argument(option, type=float, metavar="X", help=_HELP[field])
        group.add_argument(
            f"{prefix}outage",
            action="append",
            metavar="START:LENGTH",
            help="seconds in which nothing gets through; may be repeated",
        )


def command_line(options: argparse.Namespace) -> list[str]:
    """Return the options as they were given, for the relay's own process."""
    words = ["--keyed"] if options.keyed else []
    named = {"--listen": options.listen, "--to": options.to, "--seed": options.seed}
    for prefix in WAYS.values():
        for field in _FIELDS:
            named[prefix + field.replace("_", "-")] = _value(options, prefix, field)
        for outage in _value(options, prefix, "outage") or ():
            words.append(f"{prefix}outage={outage}")
    return words + [f"{name}={value}" for name, value in named.items() if value is not None]


def impairments(options: argparse.Namespace) -> tuple[dict[str, Impairment], dict[str, Outages]]:
    """Return settings and outages of each way.

    Raises
    ------
    UserError
        when an option has a value that its field cannot have.
    """
    settings, outages = {}, {}
    for way, prefix in WAYS.items():
        given = {field: _value(options, prefix, field) for field in _FIELDS}
        try:
            settings[way] = changed(Impairment(), {k: v for k, v in given.items() if v is not None})
        except ValueError as error:
            field = str(error).partition(": ")[0].strip("`")
            if field not in given:  # about several fields
                raise UserError(f"on the way {way}: {error}") from None
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
