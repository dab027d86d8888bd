# SPDX-License-Identifier: Apache-2.0
"""`groundlink fault`: inject a fault into a sensor of a run, clear its faults, or list them.

The command checks everything against the scenario of the run before it sends a query. It prints
faults in the syntax of scenarios.
"""

import argparse
import threading
from collections.abc import Sequence
from typing import Any

import msgspec

from groundlink.bus.queries import faults_key
from groundlink.bus.session import Bus
from groundlink.cli import Subparsers
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.fault_messages import CLEAR, FaultAnswer
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import KINDS, Fault, FaultSpec

ANSWER_SECONDS = 3.0
"""Timeout of a sensor, which may be busy with a revolution."""

TIMES = FaultSpec.__struct_fields__
"""Fields that are no parameters here: a live fault begins now and ends by `--for`."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("fault", help="inject a fault into a sensor of a run")
    parser.add_argument("sensor", nargs="?", metavar="VEHICLE/SENSOR", help="as in rover/lidar")
    parser.add_argument("kind", nargs="?", help=f"{', '.join(KINDS)}; or {CLEAR} to end all faults")
    parser.add_argument(
        "parameters",
        nargs="*",
        metavar="NAME=VALUE",
        help="parameters as in a scenario, such as value=0,0,0.5 of a bias",
    )
    parser.add_argument(
        "--for", type=float, dest="seconds", metavar="S", help="end after S seconds of sim time"
    )
    parser.add_argument("--list", action="store_true", help="list the active faults of all sensors")
    process.add_run_arguments(parser)
    parser.set_defaults(command=fault)


def fault(options: argparse.Namespace) -> int:
    """Change or list the faults of the sensors of a run."""
    if options.kind is None and not options.list:
        raise UserError("expected VEHICLE/SENSOR and a kind of fault, or --list")
    wanted = None
    if not options.list:
        wanted = parsed(options.kind, options.parameters, options.seconds)
    with Bus(connect=process.endpoint(options)) as bus:
        run, scenario = join(bus, options.run, threading.Event())
        if options.list:
            _show(bus, run, scenario.sensor_names())
            return 0
        found = scenario.sensor(options.sensor)
        if found is None:
            hint = did_you_mean(options.sensor, scenario.sensor_names())
            raise UserError(f"run `{run}` has no sensor `{options.sensor}`; {hint}")
        vehicle, spec = found
        if wanted is not None and (wrong := fault_problem(wanted, spec, vehicle)):
            raise UserError(f"{options.sensor}: `{wrong[0]}`: {wrong[1]}")
        query = CLEAR if wanted is None else msgspec.json.encode(wanted).decode()
        print(_query(bus, run, options.sensor, query))
    return 0


def parsed(kind: str, words: Sequence[str], seconds: float | None) -> Fault | None:
    """Return the fault of the command line's words; None to end all faults.

    Raises
    ------
    UserError
        if the words are no valid fault.
    """
    if kind == CLEAR:
        if words or seconds is not None:
            raise UserError("`clear` takes no parameters; it ends all faults of the sensor")
        return None
    if kind not in KINDS:
        raise UserError(f"unknown kind of fault `{kind}`; {did_you_mean(kind, [*KINDS, CLEAR])}")
    fields = {f.name: f for f in msgspec.structs.fields(KINDS[kind]) if f.name not in TIMES}
    given: dict[str, Any] = {} if seconds is None else {"for_s": seconds}
    for word in words:
        name, _, text = word.partition("=")
        if name not in fields or not text:
            hint = did_you_mean(name, fields) if fields else "this kind has no parameters"
            raise UserError(f"`{word}`: unknown parameter of `{kind}`; {hint}")
        values = [_value(part) for part in text.strip("[]").split(",")]
        given[name] = values if len(values) > 1 else values[0]
    for name, field in fields.items():
        if field.required and name not in given:
            raise UserError(f"`{kind}`: parameter `{name}` is missing. Fix: add {name}=VALUE")
    try:
        wanted: Fault = msgspec.convert({"kind": kind, **given}, Fault)
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$.")
        at = f"`{place.strip('`')}`: " if place else ""
        raise UserError(f"{kind}: {at}{problem[:1].lower()}{problem[1:]}") from None
    return wanted


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _show(bus: Bus, run: str, sensors: Sequence[str]) -> None:
    replies = bus.query(faults_key(run, "*/*"), seconds=ANSWER_SECONDS)
    answers = {key.rpartition("/")[0]: payload for key, payload in replies.items()}
    for sensor in sensors:
        payload = answers.get(faults_key(run, sensor))
        print(f"{sensor}: does not respond" if payload is None else _answer_text(sensor, payload))


def _query(bus: Bus, run: str, sensor: str, query: str) -> str:
    replies = bus.query(faults_key(run, sensor), query, seconds=ANSWER_SECONDS)
    if not replies:
        raise UserError(
            f"run `{run}`: {sensor} does not respond. Fix: check that its process is running"
        )
    return _answer_text(sensor, next(iter(replies.values())))


def _answer_text(sensor: str, payload: bytes) -> str:
    """Return the answer of a sensor as lines.

    Raises
    ------
    UserError
        if the sensor rejected the query.
    """
    answer = msgspec.json.decode(payload, type=FaultAnswer)
    if answer.error:
        raise UserError(f"{sensor}: {answer.error}")
    head = f"{sensor}, from tick {answer.tick} ({answer.tick * TICK_SECONDS:.4f} s):"
    return "\n  ".join([head, *map(str, answer.active)]) if answer.active else f"{head} no fault"
