# SPDX-License-Identifier: Apache-2.0
"""Write the tables of clauses and faults into their page.

`PYTHONPATH=conformance/src .venv/bin/python -m tests.conformance.tables`
"""

import re
import sys
from pathlib import Path

from sensor_conformance.checking import check_recording
from sensor_conformance.clauses import TABLE
from sensor_conformance.clauses.clause import Clause
from sensor_conformance.clauses.stamps import PERIODIC
from sensor_conformance.readings.base import TopicReadings
from sensor_conformance.readings.recording import READERS

from . import faults, packet_faults  # noqa: F401  (they fill the list)
from .fault import FAULTS, Fault
from .test_faults import with_fault

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "conformance.md"


def types_of(clause: Clause) -> str:
    if clause.applies_to == (TopicReadings,):
        return "all with a header"
    if clause.applies_to == PERIODIC:
        return "all sensors"
    kinds = [kind for kind, one in READERS.items() if one in clause.applies_to]
    names = [kind.replace("/msg/", "/").removeprefix("sensor_msgs/") for kind in kinds]
    return ", ".join(dict.fromkeys(name for name in names if name != "tf/tfMessage"))


def clause_table() -> str:
    rows = ["| clause | requirement | types | source |", "|---|---|---|---|"]
    rows += [f"| `{one.id}` | {one.title} | {types_of(one)} | {one.source} |" for one in TABLE]
    return "\n".join(rows) + "\n"


def figure(fault: Fault) -> str:
    finding = check_recording(with_fault(fault), only=[fault.clause]).findings[0]
    return finding.result.line.replace("|", "\\|")


def fault_table() -> str:
    rows = ["| seeded fault | topic | clause | figures |", "|---|---|---|---|"]
    order = {clause.id: place for place, clause in enumerate(TABLE)}
    for one in sorted(FAULTS, key=lambda fault: order[fault.clause]):
        rows.append(f"| {one.name} | `{one.topic}` | `{one.clause}` | {figure(one)} |")
    return "\n".join(rows) + "\n"


def put(text: str, name: str, table: str) -> str:
    """Replace what stands between the marks of a table."""
    marks = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    pattern = re.escape(marks[0]) + ".*?" + re.escape(marks[1])
    return re.sub(pattern, lambda _: f"{marks[0]}\n{table}\n{marks[1]}", text, flags=re.DOTALL)


def main() -> int:
    text = PAGE.read_text(encoding="utf-8")
    text = put(put(text, "clauses", clause_table()), "faults", fault_table())
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
