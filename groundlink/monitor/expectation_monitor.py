# SPDX-License-Identifier: Apache-2.0
"""Expectations of a run, judged live: by messages on its bus and by the gateway's reports."""

from collections.abc import Sequence

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.expectations.judge import ExpectationJudge
from groundlink.expectations.results import ExpectationResult
from groundlink.expectations.trackers import TopicFigures
from groundlink.messages.base import BusMessage, StreamReport
from groundlink.scenario import Scenario

from .run_monitor import RunMonitor

INBOX_DEPTH = 16384
"""Messages that may wait: of ten vehicles, 2 s of a run at ten times real time."""


class ExpectationMonitor:
    """Judges the expectations of a run with a gateway.

    Parameters
    ----------
    scenario
        None: there is nothing to judge.
    run
        the run's name.
    """

    def __init__(self, scenario: Scenario | None = None, run: str = "") -> None:
        self._judges = [] if scenario is None else [ExpectationJudge(scenario, run)]
        self._inbox: BusInbox[BusMessage] = BusInbox(depth=INBOX_DEPTH)
        self._reports: Sequence[StreamReport] = ()
        for judge in self._judges:
            judge.reported(0.0, {})  # From now on, a silent ROS side is a problem.

    def subscribe(self, bus: Bus) -> None:
        """Receive the messages that are needed."""
        for judge in self._judges:
            for key, stream in judge.streams.items():
                bus.subscribe(key, stream.message, self._inbox)

    def update(self, monitor: RunMonitor) -> None:
        """Process all messages that have come, and the newest reports of the gateway."""
        while len(self._inbox) and (arrived := self._inbox.get(seconds=0)):
            for judge in self._judges:
                judge.take(*arrived)
        if monitor.streams is not self._reports:
            self._reports = monitor.streams
            figures = {
                stream.topic: TopicFigures(stream.measured_hz, stream.age_p99_seconds)
                for stream in monitor.streams
            }
            for judge in self._judges:
                judge.reported(monitor.sim_seconds, figures)

    def finish(self) -> None:
        """Decide at the end of the run what can be decided."""
        for judge in self._judges:
            judge.finish()

    @property
    def is_settled(self) -> bool:
        """Whether the verdict on the run is known before its end."""
        return any(judge.is_settled for judge in self._judges)

    def results(self) -> list[ExpectationResult]:
        """Return the results so far."""
        return [result for judge in self._judges for result in judge.results()]
