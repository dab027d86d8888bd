# SPDX-License-Identifier: Apache-2.0
"""Runs under the control of a program: notebooks, tests and learning.

Imported by users' programs. Starts services as processes only.
"""
