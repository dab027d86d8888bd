# SPDX-License-Identifier: Apache-2.0
"""The command line `groundlink`: one module for each command. Starts services as processes only."""

import argparse
from typing import TypeAlias

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""What each command's `add_parser` adds its own parser to."""
