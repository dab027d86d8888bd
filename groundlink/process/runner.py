# SPDX-License-Identifier: Apache-2.0
"""Process runner: command-line arguments, signals and exit codes of every process.

Exit codes: 0 on SIGINT and SIGTERM; 2 for an error that the user can fix; 3 if this machine lacks
something; 4 if the scenario ends the run. Codes 2 to 4 come with one line on stderr.
"""

import _thread
import argparse
import gc
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from typing import NoReturn

from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.core.errors import (
    TOO_MANY_FILES,
    DeafSession,
    RequirementError,
    UserError,
    os_error_reason,
)

COLLECTED_OBJECTS = 10_000
"""New objects after which Python looks for unreachable cycles. Messages have none. A state of 32
vehicles is hundreds of objects, so that with the default of 700 the search took four times as long
as decoding states."""


class NoSuchHost(UserError):
    """A host name without an address (not in DNS, or not yet)."""


def parser(process: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the arguments that all processes share."""
    arguments = argparse.ArgumentParser(prog=process, description=description)
    add_run_arguments(arguments)
    return arguments


def add_run_arguments(parser: argparse._ActionsContainer) -> None:
    """Add the arguments that select a run: `--connect` and `--run`."""
    parser.add_argument(
        "--connect", metavar="ENDPOINT", help="router of the run, such as tcp/HOST:7447"
    )
    parser.add_argument("--run", help="name of the run; required if the router has several")


ROUTER_VARIABLE = "GROUNDLINK_ROUTER"
"""Environment variable with the endpoint, used without `--connect`."""


def router_of(options: argparse.Namespace) -> str | None:
    """Return the endpoint of the option or the environment; None without both."""
    return options.connect or os.environ.get(ROUTER_VARIABLE)


def endpoint(options: argparse.Namespace) -> str:
    """Return the endpoint of the option or the environment, or the default endpoint."""
    return router_of(options) or DEFAULT_ENDPOINT


def address(text: str) -> tuple[str, int]:
    """Return `HOST:PORT` as a numeric address.

    Raises
    ------
    UserError
        if the text is malformed; `NoSuchHost` if the host does not resolve.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise UserError(f"`{text}`: not an address; expected HOST:PORT such as 127.0.0.1:7511")
    try:
        return socket.gethostbyname(host), int(port)
    except OSError:
        raise NoSuchHost(f"`{text}`: host `{host}` does not resolve") from None


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        # The handler runs in the main thread, which may hold the event's lock: in `wait`, for
        # example. `set` would then wait for ever.
        signal.signal(number, lambda *_: _thread.start_new_thread(stop.set, ()))
    return stop


def run(process: str, main: Callable[[Sequence[str], threading.Event], None]) -> NoReturn:
    """Run a process's `main(arguments, stop)` and exit; SIGINT and SIGTERM set `stop`."""
    stop = stop_on_signals()
    gc.set_threshold(COLLECTED_OBJECTS)
    try:
        main(sys.argv[1:], stop)
    except DeafSession as error:
        print(f"{process}: {error}", file=sys.stderr, flush=True)
        # The same process with a new session, whoever started it and whether that restarts it.
        os.execv(sys.executable, sys.orig_argv)
    except UserError as error:
        print(f"{process}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in TOO_MANY_FILES:
            raise
        print(f"{process}: {os_error_reason(error)}", file=sys.stderr)
        sys.exit(RequirementError.exit_code)
    sys.exit(0)
