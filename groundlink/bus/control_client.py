# SPDX-License-Identifier: Apache-2.0
"""Client of a run's control and world queryables: send physics a command, return its answer."""

import time
from collections.abc import Iterator

import msgspec

from groundlink.core.errors import UserError
from groundlink.episode.control import AnyRunCommand, ControlAnswer, Restore

from .queries import control_key, journal_key, world_query_key
from .session import Bus

ANSWER_SECONDS = 7.0
"""Timeout of a query. A busy physics process answers within 6 s."""

WORLD_SECONDS = 30.0
"""Timeout of a world query. Loading a world takes seconds."""

POLL_SECONDS = 0.05
"""Poll period while a command is in progress."""

JOURNAL_SECONDS = 60.0
"""Timeout for a journal: one of a whole day has hundreds of megabytes."""


def send_command(
    bus: Bus, run: str, command: AnyRunCommand | None = None, *, content: bytes | None = None
) -> ControlAnswer:
    """Send a run command, with a payload if it needs one; return the answer of physics.

    Without a command, physics only reports the state of the run.

    Raises
    ------
    UserError
        if physics does not answer or rejects the command.
    """
    parameters = msgspec.json.encode(command).decode() if command is not None else ""
    replies = bus.query(control_key(run), parameters, seconds=ANSWER_SECONDS, content=content)
    answer = msgspec.json.decode(_only_reply(run, replies), type=ControlAnswer)
    if answer.error:
        raise UserError(f"run `{run}`: {answer.error}")
    return answer


def ask_world(bus: Bus, run: str, query: bytes) -> bytes:
    """Send a world query, JSON, to physics; return its answer, JSON as well.

    Raises
    ------
    UserError
        if physics does not answer.
    """
    return _only_reply(run, bus.query(world_query_key(run), seconds=WORLD_SECONDS, content=query))


def run_status(bus: Bus, run: str) -> ControlAnswer:
    """Return the state of a run; errors are those of `send_command`."""
    return send_command(bus, run)


def restoring(bus: Bus, run: str, content: bytes) -> Iterator[ControlAnswer]:
    """Restore a saved run from the content of its file; yield the answers of physics until then.

    Raises
    ------
    UserError
        if the file does not fit the run, which is then unchanged, or physics does not answer.
    """
    answer = send_command(bus, run, Restore(), content=content)
    yield answer
    while answer.restoring_to >= 0:
        time.sleep(POLL_SECONDS)
        answer = run_status(bus, run)
        yield answer
    if answer.failure:
        raise UserError(f"run `{run}`: {answer.failure}; the run is unchanged")


def fetch_journal(bus: Bus, run: str) -> bytes:
    """Return the journal of a run, as the content of a saved run.

    Raises
    ------
    UserError
        if physics does not answer, or has made no step yet.
    """
    content = b"".join(bus.query(journal_key(run), seconds=JOURNAL_SECONDS).values())
    if not content:
        raise UserError(
            f"run `{run}`: no journal. Fix: check that physics is running and has made a first step"
        )
    return content


def _only_reply(run: str, replies: dict[str, bytes]) -> bytes:
    """Return the reply of physics, or raise a UserError if there is none."""
    if not replies:
        raise UserError(
            f"run `{run}`: physics does not answer. Fix: check that its process is running"
        )
    return next(iter(replies.values()))
