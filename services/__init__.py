# SPDX-License-Identifier: Apache-2.0
"""The processes of a run. Each starts as ``python -m services.<name>`` and none imports another."""
