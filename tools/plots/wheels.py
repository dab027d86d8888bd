# SPDX-License-Identifier: Apache-2.0
"""Plots of wheel encoders."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from groundlink.core.frames import Floats
from services.sensors.encoders.model import EncodersModel
from services.sensors.encoders.spec import Encoders

from .cart import bench, states
from .page_style import SERIES, label, side_by_side

RUNS = 400


def _counts(angles: Floats, *, seed: int = 1, **fields: Any) -> Floats:
    """Return the left wheel's count in each state."""
    sensor = {"kind": "encoders", "name": "it", "topic": "/it", "frame": "it_link", **fields}
    made = bench({**sensor, "rate_hz": 400.0}, seed=seed)
    spec = made.vehicles[0].sensors[0]
    assert isinstance(spec, Encoders)
    model = EncodersModel(made, made.vehicles[0], spec)
    readings = [reading for state in states(angles) for reading in model.readings(state)]
    return np.array([reading.ticks[0] for reading in readings], np.float64)


def encoders() -> Figure:
    """Quantization of a count, and the error of the counted angle with slip and scale."""
    figure, (left, right) = side_by_side(2)
    per_turn = 32
    angles = np.concatenate([np.linspace(0, 1, 120), np.linspace(1, 0, 120)])
    counted = _counts(angles, ticks_per_revolution=per_turn)
    left.plot(angles, angles * per_turn / (2 * np.pi), color=SERIES[1], label="angle")
    left.plot(angles, counted, ".", color=SERIES[0], markersize=2.0, label="count")
    label(left, f"{per_turn} counts a turn", "angle of the wheel, rad", "counts")
    left.legend()

    turned = np.arange(0, 101.0, 5.0)
    fine = 2**20
    for (slip, scale), color in zip(
        ((0.01, 0.0), (0.0, 0.001), (0.01, 0.001)), SERIES, strict=False
    ):
        fields = {"ticks_per_revolution": fine, "slip_stddev": slip, "scale_stddev": scale}
        errors = [
            _counts(turned, seed=seed, **fields) * 2 * np.pi / fine - turned for seed in range(RUNS)
        ]
        law = np.sqrt(slip**2 * turned + (scale * turned) ** 2)
        right.plot(turned, law, color=color)
        text = f"slip_stddev {slip:g}, scale_stddev {scale:g}"
        right.plot(
            turned, np.sqrt(np.mean(np.square(errors), axis=0)), "o", color=color, label=text
        )
    label(right, f"RMS error over {RUNS} seeds", "angle of the wheel, rad", "error, rad")
    right.legend()
    return figure
