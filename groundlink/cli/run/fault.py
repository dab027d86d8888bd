# SPDX-License-Identifier: Apache-2.0
"""`groundlink fault`: a sensor of a run gets a fault, is rid of those it has, or tells of them.

Rule: all is checked here against the run's scenario before a sensor is asked. What was done is told
as the line that does the same in a scenario.
"""

from __future__ import annotations

import argparse
import threading
from collections.abc import Sequence
from typing import Any

import msgspec

from groundlink.bus.queries import faults_key
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError, did_you_mean
from groundlink.messages.faults import CLEAR, FaultAnswer
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import KINDS, Fault, FaultSpec

ANSWER_SECONDS = 3.0
"""How long a sensor may take to answer: it may be in the midst of a revolution."""

TIMES = FaultSpec.__struct_fields__
"""What a live fault is not given as a parameter: it begins now, and ends by `--for`."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("fault", help="let a sensor of a run fail, at once")
    parser.add_argument("sensor", nargs="?", metavar="VEHICLE/SENSOR", help="as in rover/lidar")
    parser.add_argument("kind", nargs="?", help=f"{', '.join(KINDS)}; or {CLEAR}, to end all")
    parser.add_argument(
        "parameters",
        nargs="*",
        metavar="NAME=VALUE",
        help="such as value=0,0,0.5 of a bias; as in a scenario",
    )
    parser.add_argument("--for", type=float, dest="seconds", metavar="S", help="end after S s")
    parser.add_argument("--list", action="store_true", help="tell what is in effect")
    parser.add_argument("--run", help="name of the run; needed only where several run")
    parser.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
    parser.set_defaults(command=fault)


def fault(options: argparse.Namespace) -> int:
    """Change or tell the faults of a run's sensors."""
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
        wish = CLEAR if wanted is None else msgspec.json.encode(wanted).decode()
        print(_ask(bus, run, options.sensor, wish))
    return 0


def parsed(kind: str, words: Sequence[str], seconds: float | None) -> Fault | None:
    """Return the fault that the words of a command line mean; None to end all faults.

    Raises
    ------
    UserError
        when they mean none.
    """
    if kind == CLEAR:
        if words or seconds is not None:
            raise UserError("`clear` ends all faults of the sensor; leave out what follows it")
        return None
    if kind not in KINDS:
        raise UserError(f"unknown kind of fault `{kind}`; {did_you_mean(kind, [*KINDS, CLEAR])}")
    fields = {f.name: f for f in msgspec.structs.fields(KINDS[kind]) if f.name not in TIMES}
    given: dict[str, Any] = {} if seconds is None else {"for_s": seconds}
    for word in words:
        name, _, text = word.partition("=")
        if name not in fields or not text:
            hint = did_you_mean(name, fields) if fields else "it has none"
            raise UserError(f"`{word}` is no parameter of `{kind}`; {hint}")
        values = [_value(part) for part in text.strip("[]").split(",")]
        given[name] = values if len(values) > 1 else values[0]
    for name, field in fields.items():
        if field.required and name not in given:
            raise UserError(f"`{kind}` lacks a parameter; add {name}=VALUE")
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
        print(f"{sensor}: no answer" if payload is None else _told(sensor, payload))


def _ask(bus: Bus, run: str, sensor: str, wish: str) -> str:
    replies = bus.query(faults_key(run, sensor), wish, seconds=ANSWER_SECONDS)
    if not replies:
        raise UserError(f"`{sensor}` of run `{run}` does not answer; is its process running?")
    return _told(sensor, next(iter(replies.values())))


def _told(sensor: str, payload: bytes) -> str:
    """Return a sensor's answer as lines.

    Raises
    ------
    UserError
        when it could not do what was wished.
    """
    answer = msgspec.json.decode(payload, type=FaultAnswer)
    if answer.error:
        raise UserError(f"{sensor}: {answer.error}")
    head = f"{sensor}, from tick {answer.tick} ({answer.tick * TICK_SECONDS:.4f} s) on:"
    return "\n  ".join([head, *map(str, answer.active)]) if answer.active else f"{head} no fault"
