# SPDX-License-Identifier: Apache-2.0
"""The C# library, compiled once for all tests of this folder."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from .programs import Exchange, compiled, library_in


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return library_in(tmp_path_factory.mktemp("csharp"))


@pytest.fixture(scope="session")
def exchange(library: Path) -> Iterator[Exchange]:
    """The program that answers what tests ask."""
    sources = [Path(__file__).with_name(name) for name in ("Exchange.cs", "Body.cs")]
    exchange = Exchange(compiled(library.with_name("Exchange.exe"), *sources, uses=(library,)))
    with exchange.process:
        yield exchange
        exchange.process.kill()
