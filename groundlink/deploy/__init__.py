# SPDX-License-Identifier: Apache-2.0
"""Deployment: Compose files, access control and certificates derived from a scenario.

Imported by the command line. Starts nothing.
"""
