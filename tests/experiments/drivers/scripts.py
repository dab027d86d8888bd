# SPDX-License-Identifier: Apache-2.0
"""Drivers are scripts of other environments; here they are loaded as modules."""

import importlib.util
from typing import Any

from experiments.estimation.programs import DRIVERS


def script(name: str) -> Any:
    """Return a driver, loaded anew."""
    spec = importlib.util.spec_from_file_location(f"{name}_under_test", DRIVERS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
