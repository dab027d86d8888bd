# SPDX-License-Identifier: Apache-2.0
"""Check a recording: `sensor-conformance RUN.mcap [--html report.html] [--junit results.xml]`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from .checking import CheckReport, check_file, check_source
from .clauses import TABLE
from .clauses.clause import Verdict
from .report.junit import junit
from .report.page import page
from .sources.live import LiveSource
from .sources.source import UnreadableSource


def parser() -> argparse.ArgumentParser:
    """Return the options of the command."""
    made = argparse.ArgumentParser(
        prog="sensor-conformance",
        description="Check a recording of sensors against REP 103, 105, 117, 118, 145 and drivers.",
        epilog="exit codes: 0 all tested clauses hold, 1 a clause does not, 2 nothing was checked",
    )
    made.add_argument("bag", type=Path, nargs="?", help="bag of ROS 1 or ROS 2, MCAP file, pcap")
    made.add_argument("--live", action="store_true", help="listen to a running ROS 2 system")
    made.add_argument("--duration", type=float, metavar="S", help="seconds to read (live: 20)")
    made.add_argument("--only", action="append", default=[], metavar="CLAUSE[@TOPIC]")
    made.add_argument("--skip", action="append", default=[], metavar="CLAUSE[@TOPIC]")
    made.add_argument("--html", type=Path, metavar="FILE", help="write a page with pictures")
    made.add_argument("--junit", type=Path, metavar="FILE", help="write results as JUnit XML")
    made.add_argument("--verbose", "-v", action="store_true", help="also list what passed")
    made.add_argument("--clauses", action="store_true", help="list the clauses and exit")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Check a recording; return 0, 1 (a clause does not hold) or 2 (nothing was checked)."""
    made = parser()
    given = made.parse_args(arguments)
    if given.clauses:
        for clause in TABLE:
            print(f"{clause.id:<26} {clause.title} ({clause.source})")
        return 0
    if (given.bag is None) == (not given.live):
        made.error("expected a bag or --live")
    try:
        if given.live:
            report = check_source(LiveSource(given.duration or 20.0), given.only, given.skip)
        else:
            report = check_file(given.bag, given.only, given.skip, given.duration)
    except UnreadableSource as error:
        print(f"sensor-conformance: {error}", file=sys.stderr)
        return 2
    show(report, given.verbose)
    if given.html:
        given.html.write_text(page(report), encoding="utf-8")
    if given.junit:
        given.junit.write_text(junit(report), encoding="utf-8")
    counts = report.counts()
    if not counts[Verdict.PASSED] + counts[Verdict.FAILED]:
        print("sensor-conformance: no clause could be tested", file=sys.stderr)
        return 2
    return 1 if report.findings else 0


def show(report: CheckReport, verbose: bool) -> None:
    """Print findings, what was not tested if asked, and the numbers."""
    for one in report.results:
        if one.result.verdict is Verdict.FAILED:
            print(f"FAILED {one.clause.id} {one.topic}: {one.result.line}")
            print(f"       {one.clause.title} ({one.clause.source})")
        elif verbose:
            print(f"{one.result.verdict.value} {one.clause.id} {one.topic}: {one.result.line}")
    for topic, why in report.unread.items():
        print(f"not read {topic}: {why}")
    counts = report.counts()
    numbers = ", ".join(f"{counts[verdict]} {verdict.value}" for verdict in Verdict)
    print(f"{report.name}: {len(report.topics)} topics, {numbers}")


if __name__ == "__main__":
    sys.exit(main())
