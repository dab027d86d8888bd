# SPDX-License-Identifier: Apache-2.0
"""The mark of a test that checks one clause of the standard."""

from collections.abc import Sequence

import pytest


def clause(source: str, feature: str = "", *, needs: Sequence[str] = ()) -> pytest.MarkDecorator:
    """Name the place of a clause, the feature that it belongs to, and what a test of it needs.

    Parameters
    ----------
    source
        File and field of the standard, such as ``SpawnEntity.srv: name``.
    feature
        Name of a constant of SimulatorFeatures, or of a service that no feature announces. Without
        it, the test's parameter `feature` is the name.
    needs
        Features without which a test can't observe the clause.
    """
    return pytest.mark.clause(source, feature, tuple(needs))
