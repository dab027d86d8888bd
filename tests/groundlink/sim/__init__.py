# SPDX-License-Identifier: Apache-2.0
"""Tests of `groundlink.sim` without a run; those with one are in `tests/system`."""
