# SPDX-License-Identifier: Apache-2.0
"""ROS domains for tests: none is that of a test which runs beside."""

import itertools
import os

USABLE = 100
"""The ports of the domains below 101 lie below those that the kernel hands out."""

_workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_numbers = itertools.count(os.getpid())


def next_domain() -> str:
    """Return a domain of this worker's own, as the environment has it."""
    share = USABLE // _workers
    return str(1 + _worker * share + next(_numbers) % share)
