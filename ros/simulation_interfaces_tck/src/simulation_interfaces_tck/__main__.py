# SPDX-License-Identifier: Apache-2.0
"""Check a running simulator: `python -m simulation_interfaces_tck [--namespace /] ...`."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from .options import add_options

CLAUSES = Path(__file__).resolve().parent / "clauses"

EXIT_CODES = {pytest.ExitCode.OK: 0, pytest.ExitCode.TESTS_FAILED: 1}
"""Every other end, such as a simulator that is not there, is 2."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the clauses of all announced features; return 0, 1 (a clause fails) or 2 (no run)."""
    given = sys.argv[1:] if arguments is None else [*arguments]
    parser = argparse.ArgumentParser(
        prog="python -m simulation_interfaces_tck",
        description="Check a running simulator against the standard simulation_interfaces 2.1.",
        epilog="Other options are pytest's, such as -k, -v, -x and --collect-only.",
        allow_abbrev=False,
    )
    add_options(parser.add_argument)
    parser.parse_known_args(given)  # help and mistakes; the plugin parses the options for pytest
    # Plugins and settings of the folder where it runs would change what a clause is.
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    command = [str(CLAUSES), "-c", str(CLAUSES / "pytest.ini"), "--rootdir", str(CLAUSES)]
    command += ["-p", "simulation_interfaces_tck.plugin", "-p", "no:cacheprovider"]
    return EXIT_CODES.get(pytest.ExitCode(pytest.main([*command, *given])), 2)


if __name__ == "__main__":
    sys.exit(main())
