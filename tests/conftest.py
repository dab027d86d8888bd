# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a store of assets of their own, for them and the processes they start."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from groundlink.assets import VARIABLE


@pytest.fixture(scope="session", autouse=True)
def _store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("assets")))
        yield
