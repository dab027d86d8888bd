# SPDX-License-Identifier: Apache-2.0
"""Commands that start a run, or act on a running one.

Imported by `groundlink.cli.commands`. One module a command, and what these commands share.
"""
