# SPDX-License-Identifier: Apache-2.0
"""The command line `groundlink`: one module for each command. Starts services as processes only."""
