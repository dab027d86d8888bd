# SPDX-License-Identifier: Apache-2.0
"""The command line `groundlink`: one module a command. It starts services only as processes."""
