# SPDX-License-Identifier: Apache-2.0
"""Commands that read and write files: scenarios, recordings, worlds, reports.

Imported by `groundlink.cli.commands`. One module a command, and what these commands share.
"""
