# SPDX-License-Identifier: Apache-2.0
"""A recorded run in a viewer: first what is recorded, then streams that are simulated meanwhile."""

import itertools
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from groundlink.core.clock import NANOS
from groundlink.recording import repeated_run, resimulation
from groundlink.recording.playback import Playback, TimedMessage
from groundlink.recording.reader import Recording
from groundlink.recording.resimulation import TopicPlan
from groundlink.recording.verifying import in_recorded_world
from groundlink.scenario.decoding import decode_scenario
from services.view.reconstructed_states import ReceivedMessage, StateReconstructor
from services.view.viewer_subscriptions import streams_of

if TYPE_CHECKING:
    from services.view.__main__ import RunView

STEPS = 10
"""Number of times that the progress of a simulation is shown."""


class ViewedRecording:
    """A recording with its own sensors, or with those of another scenario.

    Parameters
    ----------
    given
        scenario in MessagePack; its sensors that differ from the recorded ones are simulated.

    Raises
    ------
    UserError
        when the vehicles would drive another way.
    """

    def __init__(self, recording: Recording, given: Path | None) -> None:
        self._recording, self.run = recording, recording.run.run
        self.scenario = recording.run.scenario
        self.plan = TopicPlan([], [*recording.types], set(), set())
        if given is not None:
            self.scenario = in_recorded_world(recording, decode_scenario(given.read_bytes()))
            resimulation.check_drive(recording.started_as, self.scenario)
            self.plan = resimulation.topic_plan(recording, self.scenario)
        every = streams_of(self.scenario, self.run).items()
        self._recorded = {path: s for path, s in every if s.topic in self.plan.copied}
        self._added = {path: s for path, s in every if s.topic in self.plan.simulated}
        self.streams = self._recorded | self._added
        """Streams by the path of their entity."""

        self._paths = {stream.key: path for path, stream in self.streams.items()}

    def show(self, view: "RunView", stop: threading.Event) -> bool:
        """Show all of it; return False if `stop` was set or the viewer was closed before."""
        view.show_text(in_words(self._recording))
        playback = Playback(self._recording, self._recorded.values(), self._added.values())
        first = self._recording.first_nanos
        if not self._pass(view, stop, playback.play(first)):
            return False
        if not self.plan.sensors:
            return True
        with repeated_run.simulated(self._recording, self.scenario, self.plan) as messages:
            view.begin_again()
            return self._pass(view, stop, playback.play(first, messages), simulated=True)

    def _pass(
        self,
        view: "RunView",
        stop: threading.Event,
        due: Iterable[TimedMessage],
        *,
        simulated: bool = False,
    ) -> bool:
        """Show messages in order; the simulated ones alone when the others were shown before."""
        truth, shown = StateReconstructor(self.scenario, self.run), -1
        for nanos, together in itertools.groupby(due, key=lambda each: each.nanos):
            if stop.is_set() or not view.alive():
                return False
            came = [
                ReceivedMessage(path, self.streams[path], each.message)
                for each in together
                if (path := self._paths[each.key])
            ]
            states, messages = truth.follow(came)
            view.take_states(states)
            for path, stream, message in messages:
                if not simulated or path in self._added:
                    view.take(path, stream, message)
            view.flush()
            if simulated and (step := int(STEPS * self._share(nanos))) > shown:
                shown = step
                self._show_progress(view, step / STEPS)
        if simulated and shown < STEPS:
            self._show_progress(view, 1.0)
        return True

    def _share(self, nanos: int) -> float:
        first, end = self._recording.first_nanos, resimulation.end_nanos(self._recording)
        return (nanos - first) / (end - first)

    def _show_progress(self, view: "RunView", share: float) -> None:
        line = f"simulated {', '.join(self.plan.sensors)}: {100 * share:.0f} %"
        print(f"view: {line}", flush=True)
        view.show_text(f"**{line}**\n\n{in_words(self._recording)}")


def in_words(recording: Recording) -> str:
    """Return a summary of a recording, as Markdown."""
    run, seconds = recording.run, (recording.last_nanos - recording.first_nanos) / NANOS
    rows = [
        f"| {name} | {topic.messages} | {_hertz(topic.declared_hz)} | {_hertz(topic.measured_hz)} |"
        for name, topic in recording.topics.items()
        if topic.messages
    ]
    head = f"### {run.scenario.name} · run {run.run}\n{recording.path.name}, {seconds:.1f} s"
    table = ["| topic | messages | declared | recorded |", "|:--|--:|--:|--:|", *rows]
    return "\n".join([head, "", *table])


def _hertz(rate_hz: float | None) -> str:
    return "" if rate_hz is None else f"{rate_hz:.4g} Hz"
