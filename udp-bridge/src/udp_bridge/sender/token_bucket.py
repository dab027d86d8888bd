# SPDX-License-Identifier: Apache-2.0
"""A mean rate and a burst, towards peers of which nothing is heard; sans-IO, as `flow` is."""

from __future__ import annotations

from typing import Optional

from udp_bridge.wire.header import NANOS

DEFAULT_RATE_BYTES_PER_S = 50e6
"""As the receiver's kernel accounts them, like the burst."""
DEFAULT_BURST_BYTES = 133120
"""Two of the largest datagrams; three quarters of a default receive buffer are 159,744."""


class TokenBucket:
    """Bounds the mean rate and the burst towards a peer that never acknowledges."""

    def __init__(
        self,
        rate_bytes_per_s: float = DEFAULT_RATE_BYTES_PER_S,
        burst_bytes: int = DEFAULT_BURST_BYTES,
    ) -> None:
        self.rate_bytes_per_s = rate_bytes_per_s
        self.burst_bytes = burst_bytes
        self._tokens = float(burst_bytes)
        self._filled_nanos: Optional[int] = None

    def sent(self, size: int, now_nanos: int) -> None:
        """Take note that a datagram of `size` bytes went out."""
        self._fill(now_nanos)
        self._tokens -= size

    def may_send(self, size: int, now_nanos: int) -> bool:
        """Tell whether a datagram of `size` bytes may go now."""
        self._fill(now_nanos)
        return self._tokens >= min(size, self.burst_bytes)

    def next_wake(self, size: int, now_nanos: int) -> int:
        """Return when the bucket will hold enough for `size` bytes."""
        self._fill(now_nanos)
        wanted = min(size, self.burst_bytes) - self._tokens
        return now_nanos + max(0, int(wanted / self.rate_bytes_per_s * NANOS) + 1)

    def room(self, size: int, now_nanos: int) -> int:
        """Return for how many datagrams of `size` bytes there are tokens."""
        self._fill(now_nanos)
        return max(0, int(self._tokens // size))

    def _fill(self, now_nanos: int) -> None:
        if self._filled_nanos is not None:
            gained = (now_nanos - self._filled_nanos) * self.rate_bytes_per_s / NANOS
            self._tokens = min(self.burst_bytes, self._tokens + gained)
        self._filled_nanos = now_nanos
