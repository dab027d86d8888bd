# SPDX-License-Identifier: Apache-2.0
"""Key figures of the recording that was made up."""

import pytest

from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.key_figures import key_figures
from tests.groundlink.report.conftest import SECONDS, SPEED_MPS


def test_figures_are_those_of_the_page(gathered: RunSummary) -> None:
    figures = key_figures(gathered)
    assert figures["driven m"] == pytest.approx(SPEED_MPS * SECONDS, rel=0.01)
    assert figures["top speed m/s"] == SPEED_MPS
    assert figures["contacts"] == 1
    assert figures["never_touches objects"] == 1.0
    assert figures["hit objects"] == 0.0
    assert figures["stuck s"] == 0.0
    assert figures["motor work J"] == pytest.approx(50 * SECONDS, rel=0.1)
    (imu,) = (stream for stream in gathered.completeness if stream.topic == "/imu")
    assert figures["/imu missing"] == imu.missing().total() - imu.missing()["in transit"] > 0
    assert figures["/imu kB/message"] == pytest.approx(0.324, rel=0.1)
