# SPDX-License-Identifier: Apache-2.0
"""`groundlink fault`: inject a fault into a sensor of a run, clear its faults, or list them.

The command checks everything against the scenario of the run before it sends a query. It prints
faults in the syntax of scenarios.
"""

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from groundlink.bus.fault_client import ANSWER_SECONDS, read_answer, send_fault
from groundlink.bus.queries import faults_key
from groundlink.bus.session import Bus
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.fault_messages import CLEAR, FaultAnswer
from groundlink.process import runner as process
from groundlink.scenario.faults import KINDS, Fault, FaultSpec, fault_from

from .connection import at_tick, joined, tick_text

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
    add_json_option(parser)
    parser.set_defaults(command=fault)


def fault(options: argparse.Namespace) -> int:
    """Change or list the faults of the sensors of a run."""
    if options.kind is None and not options.list:
        raise UserError("expected VEHICLE/SENSOR and a kind of fault, or --list")
    wanted = None
    if not options.list:
        wanted = parsed(options.kind, options.parameters, options.seconds)
    with joined(options) as (bus, run, scenario):
        if options.list:
            answers = _all_answers(bus, run, scenario.sensor_names())
            _print_answers(run, answers, as_json=options.json)
            return 0
        answer = send_fault(bus, run, scenario, options.sensor, wanted)
    _print_answers(run, {options.sensor: answer}, as_json=options.json)
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
        return fault_from({"kind": kind, **given})
    except UserError as problem:
        raise UserError(f"{kind}: {problem}") from None


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _all_answers(bus: Bus, run: str, sensors: Sequence[str]) -> dict[str, FaultAnswer | None]:
    """Return the answer of every sensor; None if its process does not respond."""
    replies = bus.query(faults_key(run, "*/*"), seconds=ANSWER_SECONDS)
    answers = {key.rpartition("/")[0]: payload for key, payload in replies.items()}
    payloads = {sensor: answers.get(faults_key(run, sensor)) for sensor in sensors}
    return {
        sensor: None if payload is None else read_answer(sensor, payload)
        for sensor, payload in payloads.items()
    }


def _print_answers(run: str, answers: Mapping[str, FaultAnswer | None], *, as_json: bool) -> None:
    """Print the active faults of sensors; in JSON `active` is null if a sensor did not respond."""
    if as_json:
        print_json([_facts(run, *answer) for answer in answers.items()])
        return
    for sensor, answer in answers.items():
        print(f"{sensor}: does not respond" if answer is None else _text(sensor, answer))


def _facts(run: str, sensor: str, answer: FaultAnswer | None) -> dict[str, object]:
    if answer is None:
        return {"run": run, "sensor": sensor, "active": None}
    return at_tick(run, answer.tick, sensor=sensor, active=answer.active)


def _text(sensor: str, answer: FaultAnswer) -> str:
    head = f"{sensor}, from {tick_text(answer.tick)}:"
    return "\n  ".join([head, *map(str, answer.active)]) if answer.active else f"{head} no fault"
