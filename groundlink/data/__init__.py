# SPDX-License-Identifier: Apache-2.0
"""Recorded runs as arrays, trajectories and files of other tools.

Imported by the command line, experiments and users' programs. Starts no process.
"""
