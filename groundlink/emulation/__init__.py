# SPDX-License-Identifier: Apache-2.0
"""A bad link on purpose: what it does to datagrams, when, and how that is told.

Rule: pure. Time and datagrams come in, datagrams with their times go out. Sockets
and threads are those of the relay and of the gateway.
"""

from __future__ import annotations

from .model import LinkDirection
from .script import LinkEvent, LinkScript, ScriptPlayer, changed
from .settings import Impairment

__all__ = ["Impairment", "LinkDirection", "LinkEvent", "LinkScript", "ScriptPlayer", "changed"]
