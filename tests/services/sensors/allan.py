# SPDX-License-Identifier: Apache-2.0
"""The Allan deviation, written from its definition (IEEE Std 952-1997, annex C)."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def allan_deviation(samples: Floats, rate_hz: float, interval_s: float) -> Floats:
    """Return the overlapping Allan deviation of each column at one averaging interval.

    Half the mean square of the differences of neighboring means, over all places of the pair.
    """
    n = round(interval_s * rate_hz)
    sums = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    means = (sums[n:] - sums[:-n]) / n
    differences = means[n:] - means[:-n]
    deviation: Floats = np.sqrt((differences**2).mean(axis=0) / 2)
    return deviation
