# SPDX-License-Identifier: Apache-2.0
"""What can be asked on the bus: the keys of its queryables, beside the streams of `topics`.

Rule: a key is written here and nowhere else. Who answers stands with each.
"""

from __future__ import annotations

from .core_topics import ROOT
from .topics import FAULTS


def scenario_key(run: str) -> str:
    """Return the key of the queryable that serves a run's resolved scenario."""
    return f"{ROOT}/{run}/scenario"


def asset_key(run: str) -> str:
    """Return the key of the queryable that serves the assets that a run's scenario names."""
    return f"{ROOT}/{run}/assets"


def link_key(run: str) -> str:
    """Return the key of the queryable by which a run's emulated link is changed and told."""
    return f"{ROOT}/{run}/link"


def faults_key(run: str, sensor: str) -> str:
    """Return the key of the queryable by which a sensor's faults are changed and told."""
    return FAULTS.key_in(run, process=sensor)


def control_key(run: str) -> str:
    """Return the key of the queryable by which a run is paused, stepped and reset."""
    return f"{ROOT}/{run}/control"


def history_key(run: str) -> str:
    """Return the key of the queryable that serves the states a rejoining sensor has missed."""
    return f"{ROOT}/{run}/state/history"


def journal_key(run: str) -> str:
    """Return the key of the queryable that serves a run's journal, see `journal`.

    The question is empty for the present life, or names one that has just ended: `LIFE`, or
    `LIFE/NUMBER` for the entries from a number on. The replies, joined, are a file of `journal`.
    """
    return f"{ROOT}/{run}/journal"
