# SPDX-License-Identifier: Apache-2.0
"""Commands and output of the verdicts on a scenario's expectations."""
