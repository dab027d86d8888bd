# SPDX-License-Identifier: Apache-2.0
"""Sums that add up over real sockets, seeded loss and duplicates, and restarts of both ends."""

from __future__ import annotations

from benchmarks.soak import soak


def test_sums_add_up_through_loss_and_restarts() -> None:
    run, memory = soak(minutes=0.03, seed=3)
    assert run.faults == []
    assert run.restarts >= 2
    assert run.rests == 2
    assert len(memory) >= 1
    counts = run.totals
    lost = sum(counts[name] for name in ("missing", "incomplete", "late", "dropped"))
    assert counts["sent"] == counts["delivered"] + lost
    assert counts["unreported"] == 0
    # Both kinds of loss did happen.
    assert min(counts["missing"], counts["incomplete"]) > 0
    assert counts["repaired"] > 0
