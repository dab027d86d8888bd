# SPDX-License-Identifier: Apache-2.0
"""Section 6.1 of the paper: transfer time of a message to ROS, by size and transport.

`benchmarks.bridge` measures and draws the paper's Figure 9.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence

from experiments.estimation.evaluation import Evaluation, write_rows
from experiments.experiment import ExperimentOptions
from experiments.recording.setups import ROOT
from groundlink.core.errors import UserError

ROSBRIDGE = "ROSBRIDGE"
"""Environment: the program `rosbridge_websocket` of a rosbridge that is installed, to go along."""


def transfer(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Measure what a message takes to ROS, by its size and the way (6.1).

    There is no trajectory to be judged.

    Raises
    ------
    UserError
        when what is claimed of the ratios does not hold, or it cannot be measured.
    """
    file = options.folder("runs", "transfer") / "times.json"
    command = ["-m", "benchmarks.bridge", "--only", "latency", "--json", str(file)]
    command += ["--figure", str(options.figure("transfer"))]
    if options.short:
        command.append("--quick")
    if rosbridge := os.environ.get(ROSBRIDGE):
        command += ["--rosbridge", rosbridge]
    else:
        options.console.print(
            f"transfer: no rosbridge goes along; {ROSBRIDGE} would name its program"
        )
    if subprocess.run([sys.executable, *command], cwd=ROOT, check=False).returncode:
        raise UserError("transfer: nothing was measured; the lines above have the cause")
    rows = json.loads(file.read_text(encoding="utf-8"))["latency"]
    ways = list(rows[0]["ms"])
    write_rows(
        options.folder("tables") / "transfer_ms.csv",
        ("bytes", *ways),
        [(f"{row['bytes']:,}", *(f"{row['ms'][way]:.3f}" for way in ways)) for row in rows],
    )
    return []
