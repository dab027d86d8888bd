# SPDX-License-Identifier: Apache-2.0
"""Shared by all processes of a run: arguments, signals, joining, health, following states.

Imported by services and commands. Contains nothing about a particular process.
"""
