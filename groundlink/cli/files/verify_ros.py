# SPDX-License-Identifier: Apache-2.0
"""`groundlink verify --ros SCENARIO -- COMMAND...`: run a ROS stack twice and compare.

Each run starts the scenario in lockstep with ROS, the ROS 2 node with a trace, and the command that
starts the stack. The messages of both traces are compared.
"""

import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.text import Text

from groundlink.cli.run import running, supervised
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import print_json
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.clock import NANOS, TICK_NANOS, TICK_SECONDS
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.extras import needs
from groundlink.monitor import process_commands
from groundlink.monitor.supervisor import end_with_parent
from groundlink.ros.node_graph import publishers
from groundlink.ros.streams import answers_mistake
from groundlink.scenario import Scenario

if TYPE_CHECKING:
    from groundlink.recording.traces import TracedMessage, TracedTopic

END_SECONDS = 0.3
"""Time that the stack gets for a clean exit."""


class RosStack(NamedTuple):
    """What `verify_ros` runs."""

    file: str
    """Scenario with `lockstep: ros`."""

    command: Sequence[str]
    """Starts the nodes."""

    seconds: float
    """Sim time of a run."""

    limit_seconds: float
    """Wall time for which sim time may stand still."""

    folder: Path | None = None
    """Working directory of the command; None: that of this process."""


class StackEnd(NamedTuple):
    """How a run with a stack ended."""

    reached_seconds: float
    """Sim time."""

    is_complete: bool
    """Whether the run reached the end of its time."""

    code: int | None
    """Exit code of the stack's command; None if it was running until the end."""


def verify_ros(stack: RosStack, *, as_json: bool = False) -> int:
    """Run a stack twice; return 0 if all messages are equal, 1 if not.

    Raises
    ------
    UserError
        if the scenario does not wait for ROS, or the stack cannot be started, ends early, or does
        not answer in the first run.
    """
    with needs("record"):
        from groundlink.recording.traces import compare_traces, read_trace
    if not stack.command:
        raise UserError("--ros: no command. Fix: pass `--ros SCENARIO -- COMMAND...`")
    scenario = running.load_scenario(stack.file)
    if scenario.time.lockstep != "ros":
        raise UserError(
            f"{stack.file}: `time.lockstep` is not `ros`. Fix: see docs/how-to/lockstep.md"
        )
    if mistake := answers_mistake(scenario):
        raise UserError(f"{stack.file}: {mistake}")
    console = terminal.console(stderr=as_json)
    traces: list[dict[str, list[TracedMessage]]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first", "second"):
            trace = Path(folder) / name
            reached_seconds = _run(stack, scenario, trace, console, name)
            if reached_seconds < stack.seconds:
                line = (
                    f"{name} run: no answer at {reached_seconds:.1f} s of {stack.seconds:g} s "
                    f"for {stack.limit_seconds:g} s"
                )
                if not traces:
                    raise UserError(f"--ros: {line}; see the lines above")
                terminal.say(console, line)
            traces.append(read_trace(trace, round(stack.seconds / TICK_SECONDS)))
    rows = compare_traces(traces[0], traces[1], publishers(scenario.time.nodes))
    if as_json:
        print_json({"identical": all(row.difference is None for row in rows), "topics": rows})
    else:
        _show(rows, console)
    return int(any(row.difference for row in rows))


def _run(stack: RosStack, scenario: Scenario, trace: Path, console: Console, name: str) -> float:
    """Run a scenario with a stack, and write a trace; return the sim time reached."""
    end = run_stack(stack, scenario, console, f"{name} run", node=("--trace", str(trace)))
    if end.code is not None and not end.is_complete:
        raise UserError(
            f"--ros: `{stack.command[0]}` ended with exit code {end.code} in the {name} run, at "
            f"{end.reached_seconds:.1f} s of {stack.seconds:g} s"
        )
    return end.reached_seconds


def run_stack(
    stack: RosStack,
    scenario: Scenario,
    console: Console,
    title: str,
    *,
    node: Sequence[str] = (),
    physics: Sequence[str] = (),
    recording: Path | None = None,
) -> StackEnd:
    """Run a scenario in fast mode with a stack, until the end of its time or of its command.

    Parameters
    ----------
    title
        name of the run in the live status.
    node, physics
        further arguments of the ROS node and of physics.
    recording
        file to record to, in the order that identical runs give identical files.

    Raises
    ------
    UserError
        if the stack cannot be started.
    SystemExit
        if a process of the run failed.
    """
    run, endpoint = f"stack_{os.getpid()}", process_commands.free_endpoint()
    commands = process_commands.commands(scenario, stack.file, run, endpoint, sensors_together=True)
    commands["physics"] += ["--mode", "fast", *physics]
    ros_side = running.ros_side(scenario.gateway, console)
    if "udp_bridge_ros2" not in ros_side:
        raise RequirementError("a ROS stack needs rclpy and the Python package `udp_bridge_ros2`")
    commands[running.ROS_SIDE] = [*ros_side, *node]
    if recording is not None:
        commands[running.RECORDER] = process_commands.recorder(str(recording), run, endpoint)
        commands[running.RECORDER] += ["--ordered", "--duration", f"{stack.seconds:g}"]
        commands["physics"] += ["--wait-for", running.RECORDER]
    supervised_run = supervised.SupervisedRun(
        commands, run, endpoint, console, finite={running.RECORDER}
    )
    monitor = supervised_run.monitor
    recorder = supervised_run.children.get(running.RECORDER)
    reached_seconds, changed = 0.0, time.monotonic()

    def is_complete() -> bool:
        return recorder.is_done if recorder else reached_seconds >= stack.seconds

    def is_over() -> bool:
        nonlocal reached_seconds, changed
        if monitor.sim_seconds > reached_seconds:
            reached_seconds, changed = monitor.sim_seconds, time.monotonic()
        is_late = time.monotonic() - changed > stack.limit_seconds
        return is_late or is_complete() or nodes.poll() is not None

    def picture() -> Text:
        return Text(f"{title}: {reached_seconds:.1f} of {stack.seconds:g} s")

    with _started(stack, supervised_run.log) as nodes:
        failed = supervised_run.go(is_over, picture)
        code = nodes.poll()
    if supervised_run.is_interrupted:
        raise KeyboardInterrupt
    if failed:
        raise SystemExit(supervised.exit_code(failed))
    for child in supervised_run.children.values():
        if child.restarts:
            terminal.say(console, f"{child.name} was restarted; differences may come from that")
    return StackEnd(reached_seconds, is_complete(), code)


@contextmanager
def _started(stack: RosStack, log: Callable[[str], None]) -> Iterator["subprocess.Popen[str]"]:
    """Start a stack in a process group; end the group as Ctrl-C does, then by force."""
    try:
        process = subprocess.Popen(
            stack.command,
            cwd=stack.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            preexec_fn=end_with_parent,
        )
    except OSError as error:
        raise UserError(f"--ros: `{stack.command[0]}`: {error.strerror}") from None
    assert process.stdout
    threading.Thread(target=_pass_on, args=(process.stdout, log), daemon=True).start()
    try:
        yield process
    finally:
        for number in (signal.SIGINT, signal.SIGKILL):
            try:
                os.killpg(process.pid, number)
                process.wait(END_SECONDS)
            except (ProcessLookupError, subprocess.TimeoutExpired):
                continue


def _pass_on(lines: IO[str], log: Callable[[str], None]) -> None:
    with lines:
        for line in lines:
            log(f"stack: {line.rstrip()}")


def _show(rows: Sequence["TracedTopic"], console: Console) -> None:
    """Print the counts of each topic, and the first difference of each that differs."""
    columns = ("first run", "second run", "equal", "first at")
    table = FittingTable("first and second run", (Column("topic", "path"), *map(Column, columns)))
    for row in rows:
        first = f"{row.difference.tick * TICK_SECONDS:.6f} s" if row.difference else "-"
        table.add_row(row.topic, str(row.first_run), str(row.second_run), str(row.equal), first)
    console.print(table)
    begin = "first difference"
    for row in rows:
        if found := row.difference:
            by = f" of node `{row.node}`" if row.node else ""
            stamp = found.stamp_nanos
            known = "" if stamp is None else f" (stamp {stamp // NANOS}.{stamp % NANOS:09d})"
            terminal.say(
                console,
                f"{begin}: {row.topic}{by} at {found.tick * TICK_NANOS / NANOS:.6f} s{known}, "
                f"message {found.number}: {found.words}",
            )
            begin = "and"
    if not any(row.difference for row in rows):
        count = sum(row.equal for row in rows)
        terminal.say(console, f"identical: {count} messages of {len(rows)} topics")
