# SPDX-License-Identifier: Apache-2.0
"""What all tests share: plugins, an asset store, and no deadline for generated examples."""

from collections.abc import Iterator

import hypothesis
import pytest

from groundlink.world.assets import VARIABLE

pytest_plugins = ["tests.strict_skips", "tests.machine_load"]

# An example that takes long on a busy machine is not a wrong one.
hypothesis.settings.register_profile("groundlink", deadline=None)
hypothesis.settings.load_profile("groundlink")


@pytest.fixture(scope="session", autouse=True)
def _store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("assets")))
        yield
