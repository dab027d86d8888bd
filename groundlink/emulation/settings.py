# SPDX-License-Identifier: Apache-2.0
"""What one direction of a link does to datagrams, as users write it.

Rule: one table of fields. Scenario, command line and changes during a run all have these names.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import Fraction01, Spec

Milliseconds = Annotated[float, Meta(ge=0, le=60_000)]


class Impairment(Spec, frozen=True, kw_only=True):
    """One direction. The default leaves every datagram as it is.

    Raises
    ------
    ValueError
        when loss and burst contradict each other.
    """

    loss: Fraction01 = 0.0
    """Share of datagrams that are lost."""

    burst: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Mean number of datagrams that are lost in a row (Gilbert 1960); 0 = each on its own."""

    duplicate: Fraction01 = 0.0
    """Share of datagrams that arrive twice."""

    reorder: Fraction01 = 0.0
    """Share of datagrams that are held up by `reorder_ms`, so that later ones overtake them."""

    reorder_ms: Milliseconds = 5.0
    delay_ms: Milliseconds = 0.0
    """Time on the way."""

    jitter_ms: Milliseconds = 0.0
    """At most this much more, evenly distributed; it changes no order."""

    rate_mbps: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Megabits of UDP payload a second; 0 = no limit."""

    queue_kb: Annotated[float, Meta(gt=0, le=1e6)] = 256.0
    """Kilobytes that may wait for the rate; what does not fit is dropped."""

    bit_errors: Fraction01 = 0.0
    """Probability of an error in each bit of UDP payload."""

    outage: bool = False
    """Nothing gets through."""

    def __post_init__(self) -> None:
        if self.burst and (self.burst < 1 or self.loss > self.burst / (1 + self.burst)):
            raise ValueError(
                f"loss {self.loss:g} cannot come in bursts of {self.burst:g} datagrams; expected "
                "burst 0 or at least 1, and loss at most burst / (1 + burst)"
            )

    def chance_of_burst(self) -> float:
        """Return the probability that a burst begins behind a datagram that was not lost.

        The share of lost datagrams of a two-state chain is p / (p + r), its mean burst 1 / r.
        """
        return self.loss / (1 - self.loss) / self.burst
