# SPDX-License-Identifier: Apache-2.0
"""When a way came by places, and how near."""

import numpy as np
import pytest

from groundlink.report.analysis.checkpoints import passages


def test_there_and_back_is_two_passages_each_at_its_nearest() -> None:
    seconds = np.arange(0, 30, 0.02)
    x = 15 - np.abs(seconds - 15)  # 1 m/s, 15 m there and back
    track = np.stack([seconds, x, np.full_like(x, 0.1)], axis=-1)
    found = passages(track, {"middle": (7.5, 0.0), "end": (15.0, 0.0), "aside": (5.0, 3.0)})
    assert [passage.checkpoint for passage in found] == ["middle", "end", "middle"]
    assert [passage.seconds for passage in found] == pytest.approx([7.5, 15.0, 22.5], abs=0.02)
    assert [passage.apart_m for passage in found] == pytest.approx([0.1] * 3, abs=1e-3)


def test_a_way_that_never_moves_has_at_most_one_passage() -> None:
    track = np.tile([0.0, 1.0, 1.0], (5, 1))
    assert [passage.seconds for passage in passages(track, {"here": (1.0, 1.5)})] == [0.0]
    assert passages(np.empty((0, 5)), {"here": (1.0, 1.5)}) == []
