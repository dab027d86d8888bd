# SPDX-License-Identifier: Apache-2.0
"""Journals of episodes, and the way back from a journal to its episode.

Every entry takes effect before the same step as the first time. Nothing is published meanwhile, and
no clock is read: the caller says how many steps to take at a time.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.control import Spawn
from groundlink.episode.journal import AnyEntry, Journal, WorldChanged, this_platform
from groundlink.process import asset_exchange
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.world import assets

from .episode import Episode

PROGRESS_SECONDS = 2.0
"""Time between log lines."""


class JournalArchive:
    """The journals of the present episode and of the one that ended last."""

    def __init__(self) -> None:
        self._ended: tuple[Journal, Sequence[Checkpoint]] | None = None
        this_platform()  # Slow the first time; not to be called first between two ticks.

    def ends(self, episode: Episode) -> None:
        """Keep the journal of an episode that ends."""
        with suppress(UserError):  # It may not have begun.
            self._ended = episode.journal(), episode.checkpoints.complete

    def journal(self, present: Episode, asked: str) -> Journal | None:
        """Return what a query of `journal_key` asks for; None if it is not there.

        Raises
        ------
        UserError
            when the episode has not begun.
        """
        number, *others = asked.split("/")
        if len(others) > 2 or not all(part.isdecimal() for part in (number or "0", *others)):
            return None
        first, *known = map(int, others or "0")
        if not number or int(number) == present.number:
            journal = present.journal(first)
            checkpoints: Sequence[Checkpoint] = present.checkpoints.complete
        elif self._ended is not None and int(number) == self._ended[0].episode:
            journal, checkpoints = self._ended
            journal = replace(journal, entries=journal.entries[first:], left_out=first)
        else:
            return None
        return replace(journal, checkpoints=tuple(checkpoints[known[0] :])) if known else journal


class JournalPlayer:
    """Replays a journal's entries into an episode as it comes to their ticks; None: no entries.

    Attributes
    ----------
    until_tick
        the journal's last tick.
    """

    def __init__(self, journal: Journal | None) -> None:
        self._entries: Iterator[AnyEntry] = iter(()) if journal is None else journal.read()
        self._next = next(self._entries, None)
        self.until_tick = -1 if journal is None else journal.tick

    def play(self, episode: Episode) -> None:
        """Apply the entries that come before the episode's next step."""
        while self._next is not None and self._next.tick <= episode.tick:
            episode.replay(self._next)
            self._next = next(self._entries, None)


class Restoration:
    """An episode on its way to the state of a journal.

    Parameters
    ----------
    episode
        of the journal's scenario, at its begin, that publishes nothing.

    Attributes
    ----------
    first_scenario
        of the episode.
    """

    def __init__(self, journal: Journal, episode: Episode) -> None:
        self.first_scenario = episode.scenario
        self._journal = journal
        self._player = JournalPlayer(journal)
        self._reported: float | None = None
        self.episode = episode

    def advance(self, ticks: int) -> bool:
        """Step this many ticks, at most to the end; return whether the end is reached.

        Raises
        ------
        ValueError, KeyError, UserError
            when an entry does not fit this world.
        """
        episode, until = self.episode, self._journal.tick
        for _ in range(min(ticks, until - episode.tick)):
            self._player.play(episode)
            episode.step()
        if episode.tick < until:
            return False
        self._player.play(episode)
        episode.take_over(self._journal.acks)
        return True

    def progress(self, now_seconds: float) -> list[str]:
        """Return a log line every few seconds."""
        if self._reported is not None and now_seconds - self._reported < PROGRESS_SECONDS:
            return []
        self._reported = now_seconds
        return [f"restoring: tick {self.episode.tick} of {self._journal.tick}"]

    def difference(self) -> str:
        """Return a line on how the result differs; empty if it is the same to the bit."""
        there, here = self._journal, self.episode.journal()
        if there.digest in ("", here.digest):  # recordings have none
            return ""
        unlike = there.made_on.differences(here.made_on)
        cause = f"it was saved with {unlike}" if unlike else "though the machine is the same"
        return (
            f"the state restored at tick {here.tick} differs from the saved one, {cause}; the run "
            "continues from it"
        )


def check_data(journal: Journal) -> None:
    """Refuse a journal whose world cannot be built here.

    Raises
    ------
    UserError
        when this machine lacks data of it, or its first entries are missing.
    """
    if journal.left_out:
        raise UserError(
            f"the saved run lacks its first {journal.left_out} entries. Fix: save it again"
        )
    begins_at = journal.checkpoint
    worlds = [begins_at.scenario] if begins_at and begins_at.scenario else []
    changes = (entry.change for entry in journal.read() if isinstance(entry, WorldChanged))
    added = (change.more for change in changes if isinstance(change, Spawn))
    needed = [
        digest for it in (journal.scenario, *worlds, *added) for digest in asset_exchange.needed(it)
    ]
    if lacking := assets.missing(needed):
        raise UserError(
            f"the host of physics lacks asset {lacking[0][:12]} of the saved world. Fix: "
            f"load its scenario there once, or copy {assets.folder()} from where it was saved"
        )


def check_processes(journal: Journal, running: Scenario) -> None:
    """Refuse a journal whose run has other processes than those that are running.

    Raises
    ------
    UserError
        when its sensors or its seed are others.
    """
    saved = journal.scenario
    if (saved.seed, _sensors(saved)) != (running.seed, _sensors(running)):
        raise UserError(
            f"the saved run, of scenario `{saved.name}`, has other sensors or another seed than "
            f"this one, of `{running.name}`. Fix: start it with `groundlink up FILE`"
        )


def _sensors(scenario: Scenario) -> dict[str, object]:
    """Return the sensors with their vehicles, which start elsewhere in a loaded world."""
    here = (replace(vehicle, placement=Placement()) for vehicle in scenario.vehicles)
    at_origin = replace(scenario, vehicles=tuple(here))
    return {name: at_origin.sensor(name) for name in at_origin.sensor_names()}
