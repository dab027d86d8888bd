# SPDX-License-Identifier: Apache-2.0
"""Sums that add up over real sockets, seeded loss and duplicates, and restarts of both ends."""

import pytest

from benchmarks.soak.__main__ import MINIMUM_MINUTES, Sample, check_memory, soak


@pytest.mark.nightly
def test_sums_add_up_through_loss_kills_and_restarts() -> None:
    run = soak(minutes=0.03, seed=3)
    assert run.faults == []
    assert run.kills == 2
    assert run.restarts >= 2
    assert run.drains >= 2
    assert {row.end for row in run.memory} == {"sender", "receiver"}
    counts = run.totals
    lost = sum(counts[name] for name in ("missing", "incomplete", "late", "dropped"))
    assert counts["sent"] == counts["delivered"] + lost
    assert counts["unreported"] == 0
    # Both kinds of loss did happen.
    assert min(counts["missing"], counts["incomplete"]) > 0
    assert counts["repaired"] > 0


@pytest.mark.parametrize(
    ("kb_per_minute", "growing"), [(-500.0, []), (0.0, []), (200.0, ["receiver"])]
)
def test_memory_that_grows_behind_the_warm_up_is_a_fault(
    kb_per_minute: float, growing: list[str]
) -> None:
    memory = []
    for second in range(600):
        warming = 1000.0 * min(second, 150)
        memory.append(Sample("sender", second, warming))
        memory.append(Sample("receiver", second, warming + kb_per_minute * second / 60))
    lines, faults = check_memory(memory, MINIMUM_MINUTES)
    assert [fault.partition(":")[0] for fault in faults] == growing
    assert f"receiver: {kb_per_minute:+.1f} kB a minute" in lines[0]
    assert check_memory(memory, MINIMUM_MINUTES / 2) == (lines, []), "too short to be judged"
