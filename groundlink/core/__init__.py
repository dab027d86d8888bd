# SPDX-License-Identifier: Apache-2.0
"""Core: errors, sim time, frames and other basics that every package uses.

May be imported by everything. Imports nothing else of Groundlink.
"""
