# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from services.sensors.noise.normal import NORMALS, PolarNormal

COUNT = 400_000


@pytest.fixture(scope="module", params=NORMALS)
def drawn(request: pytest.FixtureRequest) -> NDArray[np.float64]:
    return NORMALS[request.param](np.random.default_rng(7)).draw(COUNT)


def test_kolmogorov_smirnov_accepts_it(drawn: NDArray[np.float64]) -> None:
    assert stats.kstest(drawn, "norm").pvalue > 0.01
    # Each point of the disc gives two numbers; both halves must be normal.
    assert stats.kstest(drawn[::2], "norm").pvalue > 0.01
    assert stats.kstest(drawn[1::2], "norm").pvalue > 0.01


@pytest.mark.parametrize(
    ("power", "expected", "variance"),
    [(1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)],
)
def test_moments(drawn: NDArray[np.float64], power: int, expected: float, variance: float) -> None:
    """`variance` is that of x**power for a normal x."""
    assert abs((drawn**power).mean() - expected) < 5 * np.sqrt(variance / COUNT)


@pytest.mark.parametrize("sigmas", [1, 2, 3, 4])
def test_tails(drawn: NDArray[np.float64], sigmas: int) -> None:
    for tail in (drawn > sigmas, drawn < -sigmas):
        expected = COUNT * stats.norm.sf(sigmas)
        assert abs(tail.sum() - expected) < 5 * np.sqrt(expected)


def test_neighbors_are_independent(drawn: NDArray[np.float64]) -> None:
    for lag in (1, 2, 3):
        for power in (1, 2):
            a, b = drawn[:-lag] ** power, drawn[lag:] ** power
            assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(COUNT)


@pytest.mark.parametrize("name", NORMALS)
@pytest.mark.parametrize("chunks", [[1] * 50, [0, 3, 0, 999, 1], [100_000, 7], [7, 100_000]])
def test_numbers_do_not_depend_on_how_they_are_drawn(name: str, chunks: list[int]) -> None:
    source = NORMALS[name](np.random.default_rng(11))
    parts = [source.draw(count) for count in chunks]
    assert [len(part) for part in parts] == chunks
    whole = NORMALS[name](np.random.default_rng(11)).draw(sum(chunks))
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_it_is_the_polar_method() -> None:
    """The first accepted point of the generator's square, by the textbook's formula."""
    generator = np.random.default_rng(5)
    while True:
        u, v = 2 * generator.random(2) - 1
        s = u * u + v * v
        if 0 < s < 1:
            break
    factor = np.sqrt(-2 * np.log(s) / s)
    np.testing.assert_allclose(
        PolarNormal(np.random.default_rng(5)).draw(2), [u * factor, v * factor], rtol=1e-14
    )
