# SPDX-License-Identifier: Apache-2.0
"""Impairments of one direction of a link: fields of scenarios, options and live changes."""

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import Fraction01, Spec

Milliseconds = Annotated[float, Meta(ge=0, le=60_000)]


class Impairment(Spec, frozen=True, kw_only=True):
    """Impairments of one direction; none by default.

    Raises
    ------
    ValueError
        if loss and burst contradict each other.
    """

    loss: Fraction01 = 0.0
    """Share of lost datagrams."""

    burst: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Mean length of loss bursts in datagrams (Gilbert 1960); 0 = independent losses."""

    duplicate: Fraction01 = 0.0
    """Share of duplicated datagrams."""

    reorder: Fraction01 = 0.0
    """Share of datagrams delayed by `reorder_ms`, so that later ones overtake them."""

    reorder_ms: Milliseconds = 5.0
    """Delay of reordered datagrams."""

    delay_ms: Milliseconds = 0.0
    """Constant delay of each datagram."""

    jitter_ms: Milliseconds = 0.0
    """Maximum additional delay, uniformly distributed; keeps the order."""

    rate_mbps: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Rate limit in megabits of UDP payload a second; 0 = none."""

    queue_kb: Annotated[float, Meta(gt=0, le=1e6)] = 256.0
    """Queue of the rate limit in kilobytes; further datagrams are dropped."""

    bit_errors: Fraction01 = 0.0
    """Bit error probability of the UDP payload."""

    outage: bool = False
    """Drop every datagram."""

    def __post_init__(self) -> None:
        if self.burst and (self.burst < 1 or self.loss > self.burst / (1 + self.burst)):
            raise ValueError(
                f"loss {self.loss:g} is impossible with bursts of {self.burst:g} datagrams; "
                "expected burst 0 or at least 1, and loss at most burst / (1 + burst)"
            )

    def chance_of_burst(self) -> float:
        """Return the probability that a burst starts after a datagram that was not lost.

        In a two-state chain the share of losses is p / (p + r) and the mean burst 1 / r.
        """
        return self.loss / (1 - self.loss) / self.burst
