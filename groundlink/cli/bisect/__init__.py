# SPDX-License-Identifier: Apache-2.0
"""`groundlink bisect`: what is varied, the probes, and the result.

The search itself is in `groundlink/bisection`.
"""
