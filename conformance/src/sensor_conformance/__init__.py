# SPDX-License-Identifier: Apache-2.0
"""A conformance kit for recordings of robot sensors.

`check_recording` judges a recording by all clauses. `sources` read bags, `readings` turn messages
into arrays, `clauses` judge them, `report` writes what they found. No simulator is needed.
"""

from .checking import CheckReport, CheckResult, check_file, check_recording, check_source

__all__ = ["CheckReport", "CheckResult", "check_file", "check_recording", "check_source"]
