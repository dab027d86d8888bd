# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what a run is made of, as data that is checked as a whole before anything starts."""

from .document import ScenarioError
from .load import load
from .schema import Scenario

__all__ = ["Scenario", "ScenarioError", "load"]
