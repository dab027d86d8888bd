# SPDX-License-Identifier: Apache-2.0
"""Cost of many vehicles: measured on this machine, and modeled on many hosts."""
