# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks [NAME ...]`: run the benchmarks that the documents quote.

Fails (exit code 1) when a claim does not hold.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .claims import Claim

NAMES = ("physics", "lidar", "camera", "lockstep", "bridge", "resim", "drift")
"""Each is `python -m benchmarks.NAME`; `drift` takes ten minutes."""


def run(name: str) -> list[Claim]:
    """Run a benchmark; return its claims.

    Raises
    ------
    RuntimeError
        when it fails before it has measured all of them.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "claims.json")
        command = [sys.executable, "-m", f"benchmarks.{name}", "--claims", str(file)]
        done = subprocess.run(command, check=False)
        if not file.exists():
            raise RuntimeError(f"benchmarks.{name} ended with {done.returncode} and no figures")
        return [Claim(**row) for row in json.loads(file.read_text(encoding="utf-8"))]


def main(arguments: Sequence[str]) -> int:
    """Run benchmarks; return 0 when all claims hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(NAMES)} (all)")
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(NAMES):
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; expected {', '.join(NAMES)}")
    claims = [claim for name in options.names or NAMES for claim in run(name)]
    broken = [claim for claim in claims if not claim.holds]
    print("", *broken, sep="\n")
    return int(bool(broken))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
