# SPDX-License-Identifier: Apache-2.0
"""From an episode to its journal, and from a journal back to the episode that it tells of.

Rule: every entry is taken in before the step before which it was taken in first; nothing is
published on the way. Reads no clock: whoever restores says how many steps at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.messages.control import Spawn
from groundlink.process import asset_exchange
from groundlink.run.journal import AnyEntry, Changed, Journal, this_machine
from groundlink.scenario import Scenario
from groundlink.world import assets

from .episode import Episode

SAID_EVERY_SECONDS = 2.0
"""Of progress."""


class JournalArchive:
    """The journals of a run: of its present episode, and of the one that has just ended."""

    def __init__(self) -> None:
        self._ended: Journal | None = None
        this_machine()  # It takes a while to find out, once: not between two ticks.

    def ends(self, episode: Episode) -> None:
        """Keep the journal of an episode that ends."""
        with suppress(UserError):  # It may not have begun.
            self._ended = episode.journal()

    def journal(self, present: Episode, asked: str) -> Journal | None:
        """Return what a query of `journal_key` asks for; None where there is no such thing.

        Raises
        ------
        UserError
            when the episode has not begun.
        """
        number, _, left_out = asked.partition("/")
        if not (number + left_out).isdecimal() and asked:
            return None
        first = int(left_out or 0)
        if not number or int(number) == present.number:
            return present.journal(first)
        if self._ended is None or int(number) != self._ended.life:
            return None
        return replace(self._ended, entries=self._ended.entries[first:], left_out=first)


class JournalPlayer:
    """Tells an episode what an earlier one was told, when it has come so far; of none, nothing."""

    def __init__(self, journal: Journal | None) -> None:
        self._entries: Iterator[AnyEntry] = iter(()) if journal is None else journal.read()
        self._next = next(self._entries, None)
        self.until_tick = -1 if journal is None else journal.tick
        """Where what is known of that earlier episode ends."""

    def tell(self, episode: Episode) -> None:
        """Have it take in what comes before its next step."""
        while self._next is not None and self._next.tick <= episode.tick:
            episode.follow(self._next)
            self._next = next(self._entries, None)


class Restoration:
    """An episode on its way to where another one was.

    Parameters
    ----------
    episode
        that journal's, at tick 0, which publishes nothing.
    """

    def __init__(self, journal: Journal, episode: Episode) -> None:
        self._journal = journal
        self._player = JournalPlayer(journal)
        self._said: float | None = None
        self.episode = episode

    def go_on(self, ticks: int) -> bool:
        """Step so many ticks, or fewer to the end; return whether it has come there.

        Raises
        ------
        ValueError, KeyError, UserError
            when an entry is none for this world.
        """
        episode, until = self.episode, self._journal.tick
        for _ in range(min(ticks, until - episode.tick)):
            self._player.tell(episode)
            episode.step()
        if episode.tick < until:
            return False
        self._player.tell(episode)
        episode.succeed(self._journal.acks)
        return True

    def progress(self, now_seconds: float) -> list[str]:
        """Return a line on how far it is, now and then."""
        if self._said is not None and now_seconds - self._said < SAID_EVERY_SECONDS:
            return []
        self._said = now_seconds
        return [f"restores: tick {self.episode.tick} of {self._journal.tick}"]

    def difference(self) -> str:
        """Return one line of how it came out different; empty where it is the same to the bit."""
        there, here = self._journal, self.episode.journal()
        if here.digest == there.digest:
            return ""
        unlike = there.made_on.unlike(here.made_on)
        cause = f"it was saved with {unlike}" if unlike else "though the machine is the same"
        return (
            f"what was restored at tick {here.tick} is not the same to the bit as what was saved, "
            f"{cause}; the run goes on from there"
        )


def check_data(journal: Journal) -> None:
    """Refuse a journal whose world cannot be built here.

    Raises
    ------
    UserError
        when this machine lacks data of it, or its start is missing.
    """
    if journal.left_out:
        raise UserError(f"the saved run lacks its first {journal.left_out} entries; save it again")
    changes = (entry.wish for entry in journal.read() if isinstance(entry, Changed))
    added = (wish.more for wish in changes if isinstance(wish, Spawn))
    needed = [digest for it in (journal.scenario, *added) for digest in asset_exchange.needed(it)]
    if lacking := assets.missing(needed):
        raise UserError(
            f"physics' machine lacks the data {lacking[0][:12]} of the saved run's world; load its "
            f"scenario there once, or copy {assets.folder()} from where it was saved"
        )


def check_processes(journal: Journal, running: Scenario) -> None:
    """Refuse a journal of another run than one of a scenario, whose processes are there.

    Raises
    ------
    UserError
        when its sensors are others.
    """
    saved = journal.scenario
    if (saved.seed, _sensors(saved)) != (running.seed, _sensors(running)):
        raise UserError(
            f"the saved run, of scenario `{saved.name}`, has other sensors or another seed than "
            f"this one, of `{running.name}`; start it by `groundlink up FILE`"
        )


def _sensors(scenario: Scenario) -> dict[str, object]:
    return {name: scenario.sensor(name) for name in scenario.sensor_names()}
