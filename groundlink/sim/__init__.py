# SPDX-License-Identifier: Apache-2.0
"""Runs under the control of a program: notebooks, tests, learning and scenarios.

Imported by users' programs. Starts services as processes only.
"""
