# SPDX-License-Identifier: Apache-2.0
"""A bad link on purpose: what it does to datagrams, when, and how that is told.

Rule: pure. Time and datagrams come in, datagrams with their times go out. Sockets
and threads are those of the relay and of the gateway.
"""

from __future__ import annotations

from .model import OneWay
from .script import Event, LinkScript, Script, changed
from .settings import Impairment

__all__ = ["Event", "Impairment", "LinkScript", "OneWay", "Script", "changed"]
