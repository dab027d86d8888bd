# SPDX-License-Identifier: Apache-2.0
"""The C extension `_batch_io`: many datagrams per system call, without the interpreter.

`udp_socket` and `credit_mailbox` use it as `batch_io`, and work without it. It is None where the
extension was not built, and with UDP_BRIDGE_PLAIN=1 in the environment.
"""

from __future__ import annotations

import importlib
import os
from typing import Any

batch_io: Any = None
if os.environ.get("UDP_BRIDGE_PLAIN") is None:
    try:
        batch_io = importlib.import_module("._batch_io", __name__)
    except ImportError:
        pass
