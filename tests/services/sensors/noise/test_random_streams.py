# SPDX-License-Identifier: Apache-2.0
"""Random numbers are a function of seed, sensor, purpose and tick."""

import itertools

import numpy as np

from services.sensors.noise.random_streams import RandomStreams


def test_the_same_key_draws_the_same_whatever_was_drawn_before() -> None:
    streams = RandomStreams(1, "rover/lidar")
    first = streams.at("range", 40).standard_normal(100)
    streams.at("bias", 0).random(17)
    streams.at("range", 41).random(3)
    np.testing.assert_array_equal(streams.at("range", 40).standard_normal(100), first)
    again = RandomStreams(1, "rover/lidar").at("range", 40).standard_normal(100)
    np.testing.assert_array_equal(again, first)


def test_every_part_of_the_key_counts() -> None:
    keys = itertools.product((1, 2), ("rover/lidar", "rover/imu"), ("range", "bias"), (0, 1, 40))
    draws = [RandomStreams(seed, name).at(use, tick).random(4) for seed, name, use, tick in keys]
    assert len({draw.tobytes() for draw in draws}) == 24


def test_neighboring_ticks_do_not_overlap() -> None:
    streams = RandomStreams(1, "rover/lidar")
    first, second = (streams.at("range", tick).random(100_000) for tick in (0, 1))
    assert not set(first) & set(second)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(100_000)
