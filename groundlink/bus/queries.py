# SPDX-License-Identifier: Apache-2.0
"""Keys of the queryables of a run. Keys of streams are in `topics`. No other module writes keys."""

from .core_topics import ROOT
from .topics import FAULTS


def scenario_key(run: str) -> str:
    """Return the key of a run's resolved scenario. Served by physics or a replay."""
    return f"{ROOT}/{run}/scenario"


def asset_key(run: str) -> str:
    """Return the key of the assets that a run's scenario names. Served with the scenario."""
    return f"{ROOT}/{run}/assets"


def link_key(run: str) -> str:
    """Return the key that reads and changes a run's emulated link. Served by the gateway."""
    return f"{ROOT}/{run}/link"


def faults_key(run: str, sensor: str) -> str:
    """Return the key that reads and changes a sensor's faults. Served by the sensor."""
    return FAULTS.key_in(run, process=sensor)


def control_key(run: str) -> str:
    """Return the key that takes run commands (see `messages.control`). Served by physics."""
    return f"{ROOT}/{run}/control"


def world_query_key(run: str) -> str:
    """Return the key that takes world queries (see `episode.world_queries`). Served by physics."""
    return f"{ROOT}/{run}/world"


def history_key(run: str) -> str:
    """Return the key of the states that a rejoining process missed. Served by physics."""
    return f"{ROOT}/{run}/state/history"


def ruts_key(run: str) -> str:
    """Return the key of ruts by their digest, as parameter in hexadecimal. Served by physics.

    The replies, joined, are tiles (see `world.ruts`). Physics keeps the ruts of its last states.
    """
    return f"{ROOT}/{run}/ruts"


def journal_key(run: str) -> str:
    """Return the key of a run's journal (see `run.journal`). Served by physics.

    Empty parameters select the current episode. `EPISODE` selects one that has just ended, and
    `EPISODE/NUMBER` its entries from a number on; `/NUMBER`, those of the current episode.
    `EPISODE/NUMBER/NUMBER` adds its checkpoints from a number on. The replies, joined, are a
    journal file.
    """
    return f"{ROOT}/{run}/journal"


def points_key() -> str:
    """Return the key at which workers report to a search and get points. Served by the search."""
    return f"{ROOT}/search/points"
