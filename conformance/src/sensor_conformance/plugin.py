# SPDX-License-Identifier: Apache-2.0
"""pytest plugin: a recording that the command line names becomes tests, one a clause and topic.

`pytest run.mcap` is enough where the kit is installed; elsewhere
`pytest -p sensor_conformance.plugin run.mcap`. Recordings in a folder of tests are left alone.
"""

from collections.abc import Iterable
from pathlib import Path

import pytest

from .checking import CheckResult, check_file
from .clauses.clause import Verdict
from .sources.source import UnreadableSource

SUFFIXES = (".bag", ".db3", ".mcap", ".pcap")


class RecordedFile(pytest.File):
    """A recording whose clauses are tests."""

    def collect(self) -> Iterable["ClauseItem"]:
        """Check the recording; yield an item for each result."""
        options = self.config.option
        try:
            report = check_file(self.path, options.conformance_only, options.conformance_skip)
        except UnreadableSource as error:
            raise self.CollectError(str(error)) from error
        for one in report.results:
            name = f"{one.clause.id}[{one.topic}]"
            yield ClauseItem.from_parent(self, name=name, checked=one)


class ClauseItem(pytest.Item):
    """One clause for one topic."""

    def __init__(self, *, checked: CheckResult, **others: object) -> None:
        super().__init__(**others)  # type: ignore[arg-type]
        self._checked = checked
        self.user_properties += [
            ("clause", checked.clause.id),
            ("source", checked.clause.source),
            ("figures", checked.result.line),
        ]

    def runtest(self) -> None:
        """Pass, fail or skip by the result."""
        verdict, line = self._checked.result.verdict, self._checked.result.line
        if verdict is Verdict.NOT_TESTED:
            pytest.skip(line)
        if verdict is Verdict.FAILED:
            pytest.fail(f"{line}: {self._checked.clause.title}", pytrace=False)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the recording and the name of the item."""
        return self.path, None, self.name


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("conformance of recordings")
    group.addoption("--conformance-only", action="append", default=[], metavar="CLAUSE[@TOPIC]")
    group.addoption("--conformance-skip", action="append", default=[], metavar="CLAUSE[@TOPIC]")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> RecordedFile | None:
    """Collect a recording if it was named."""
    if file_path.suffix in SUFFIXES and parent.session.isinitpath(file_path):
        return RecordedFile.from_parent(parent, path=file_path)
    return None
