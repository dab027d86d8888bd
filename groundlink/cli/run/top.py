# SPDX-License-Identifier: Apache-2.0
"""`groundlink top`: show the processes of a run with host, state, rates and counters.

Subscribes only, except for a query for the settings of the emulated link.
"""

import argparse
import time
from collections import deque
from typing import Any

import msgspec
from rich.console import Group, RenderableType
from rich.live import Live
from rich.text import Text

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import link_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import process_names
from groundlink.cli import Subparsers
from groundlink.cli.run.dashboard import missions_table, streams_table
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.output import console
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.episode.fault_messages import kinds_in
from groundlink.messages import missing_readings
from groundlink.messages.base import Health
from groundlink.monitor.mission_monitor import MissionMonitor
from groundlink.monitor.overview import Overview
from groundlink.process import runner as process
from groundlink.scenario import Scenario

from .connection import joined

PERIOD_SECONDS = 1.0
"""Period of JSON objects and of queries for the link."""

ONCE_SECONDS = 3.5
"""Maximum wait of `--once` for two health messages of every process."""

STYLES = {"alive": "", "there": "", "silent": "yellow", "missing": "yellow", "gone": "red"}


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("top", help="show the processes and streams of a run, live")
    process.add_run_arguments(parser)
    add_json_option(parser, "print a JSON object each second")
    parser.add_argument("--once", action="store_true", help="print the state once and exit")
    parser.set_defaults(command=top)


def top(options: argparse.Namespace) -> int:
    """Show a run until Ctrl-C."""
    stop = process.stop_on_signals()
    shown = console()
    with joined(options, stop=stop, observer=True) as (bus, run, scenario):
        overview = Overview(run, declared_rates(scenario), MissionMonitor(scenario))
        overview.missions.subscribe(bus, run)
        prefix = HEALTH.key_in(run, process="")
        moves: deque[tuple[str, bool]] = deque()
        inbox: BusInbox[Health] = BusInbox(depth=1024)
        bus.subscribe(HEALTH.key_in(run), Health, inbox)
        bus.watch(HEALTH.key_in(run), lambda key, there: moves.append((key, there)))
        begun = time.monotonic()
        next_second = begun + PERIOD_SECONDS
        live = None
        if shown.is_terminal and not options.json and not options.once:
            live = Live(console=shown, auto_refresh=False, screen=False)
            live.start()

        def show(now: float) -> None:
            _query_link(bus, run, scenario, overview)
            if options.json:
                print_json(overview.snapshot(now), indent=None)
            elif not live:
                shown.print(picture(overview, now))

        try:
            while not stop.is_set():
                while arrived := inbox.get(seconds=0.0 if len(inbox) else 0.1):
                    overview.update(arrived[1], time.monotonic())
                while moves:
                    key, there = moves.popleft()
                    overview.presence_changed(key.removeprefix(prefix), there)
                overview.missions.update()
                now = time.monotonic()
                if options.once:
                    if overview.has_rates or now - begun > ONCE_SECONDS:
                        break
                    continue
                if live:
                    live.update(picture(overview, now), refresh=True)
                if now >= next_second:
                    next_second += PERIOD_SECONDS
                    show(now)
        finally:
            if live:
                live.stop()
        if options.once and not stop.is_set():
            show(time.monotonic())
    return 0


def declared_rates(scenario: Scenario) -> dict[str, float | None]:
    """Return the processes that a scenario declares, with the rate of their messages."""
    rates: dict[str, float | None] = dict.fromkeys(process_names(scenario))
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            rate_hz = sensor.message_rate_hz * len(sensor.ros_topics())
            rates[f"{vehicle.name}/{sensor.name}"] = rate_hz
    return rates


def _query_link(bus: Bus, run: str, scenario: Scenario, overview: Overview) -> None:
    """Query the gateway for the settings of the emulated link, if the scenario has one."""
    if scenario.gateway.link is None:
        return
    for reply in bus.query(link_key(run), seconds=PERIOD_SECONDS).values():
        _, overview.link_settings = msgspec.json.decode(
            reply, type=tuple[str, dict[str, dict[str, float | bool]]]
        )


def picture(overview: Overview, now_seconds: float) -> RenderableType:
    """Return the run as tables."""
    now = overview.snapshot(now_seconds)
    factor = now["real_time_factor"]
    pace = "-" if factor is None else f"{factor:.3f}"
    head = f"run `{now['run']}`   sim time {now['sim_seconds']:.1f} s   real-time factor {pace}"
    parts: list[RenderableType] = [Text(head, style="bold"), _processes(now["processes"])]
    if stalls := str(overview.monitor.stalls):
        parts.insert(1, Text(stalls, style="yellow"))
    if missions := overview.missions.missions():
        parts.append(missions_table(missions))
    if overview.monitor.streams:
        parts.append(streams_table(overview.monitor.streams))
    else:
        parts.append(Text("no stream reports: no gateway is running"))
    parts += [Text(line) for line in _link_lines(now["link"])]
    return Group(*parts)


_PROCESSES = (
    Column("name", "text"),
    Column("state", "text"),
    Column("host", "text", omit_order=1),
    Column("pid", omit_order=2),
    Column("declared", omit_order=3),
    Column("measured"),
    Column("missing readings", "words"),
    Column("counts", "words"),
)


def _processes(rows: list[dict[str, Any]]) -> FittingTable:
    table = FittingTable("processes", _PROCESSES)
    for row in rows:
        missing, counts = missing_readings.parted(row["counters"])
        table.add_row(
            row["name"],
            _state(row),
            row["host"] or "-",
            "-" if row["pid"] is None else str(row["pid"]),
            "" if row["declared_hz"] is None else f"{row['declared_hz']:g} Hz",
            "" if row["measured_hz"] is None else f"{row['measured_hz']:.1f} Hz",
            missing_readings.in_words(missing),
            ", ".join(f"{name} {count}" for name, count in counts.items() if count),
            style=STYLES[row["state"]]
            or ("yellow" if missing or kinds_in(row["counters"]) else ""),
        )
    return table


def _state(row: dict[str, Any]) -> str:
    text: str = row["state"]
    if text == "silent":
        text += f" {row['heard_seconds_ago']:.0f} s"
    text = ", ".join([text, *kinds_in(row["counters"])])
    return f"{text}, {row['restarts']} restarts" if row["restarts"] else text


def _link_lines(link: dict[str, Any]) -> list[str]:
    lines = []
    for way, fields in link["settings"].items():
        lines.append(f"link {way}: " + ", ".join(f"{name} {v}" for name, v in fields.items()))
    if counts := {name: count for name, count in link["counters"].items() if count}:
        lines.append("link counts: " + ", ".join(f"{n} {count}" for n, count in counts.items()))
    return lines
