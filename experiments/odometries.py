# SPDX-License-Identifier: Apache-2.0
"""The programs that take clouds, with an IMU or without, and how they are run on a recording.

Rule: one place says which frame an estimate is of; every experiment with clouds uses it, so that
their figures can be compared.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from . import environments
from .evaluation import Result
from .experiment import Options, Way, judged
from .programs import GENZ_LIO, KISS_ICP, SMALL_GICP, Program
from .recordings import Recording


@dataclass(frozen=True)
class Odometry:
    """A way to run a program."""

    program: Program
    frame: str
    """Whose trajectory it tells."""

    settings: tuple[str, ...] = ()
    """Options of its driver."""

    def run(self, options: Options, bag: Path, tum: Path, *more: str, label: str) -> float:
        """Run it on a bag; return the seconds that it took."""
        began_s = time.monotonic()
        environments.run(
            self.program,
            [bag, tum, *self.settings, *more],
            options.out,
            options.say,
            label=label,
            log=tum.with_suffix(".log"),
        )
        return time.monotonic() - began_s


AT_REST_S = 1.0
"""By then a vehicle has come to rest on its springs, and still crawls."""

LIDAR_INERTIAL = Odometry(GENZ_LIO, "imu_link", ("--from-s", str(AT_REST_S)))
KISS = Odometry(KISS_ICP, "lidar_link")
GICP = Odometry(SMALL_GICP, "lidar_link")


def ran(
    options: Options,
    odometry: Odometry,
    recording: Recording,
    *,
    experiment: str,
    seed: int,
    case: str = "",
    more: Sequence[str] = (),
    bag: Path | None = None,
    frame: str = "",
    limit_m: float = 0.0,
) -> tuple[Result, Way]:
    """Run a program on a recording and return how well it did.

    Parameters
    ----------
    more
        options of its driver, beside its settings.
    bag
        what it gets in place of the recording's own.
    frame
        whose trajectory it tells, where that is another one than usual.
    """
    words = "_".join([odometry.program.name, *case.replace("%", "").split()])
    tum = options.folder("runs", recording.folder.name) / f"{experiment}_{words}.tum"
    took_s = odometry.run(
        options, bag or recording.bag, tum, *more, label=f"{experiment}, seed {seed} {case}".strip()
    )
    return judged(
        options,
        recording,
        tum,
        frame=frame or odometry.frame,
        seed=seed,
        experiment=experiment,
        program=odometry.program.name,
        case=case,
        took_s=took_s,
        limit_m=limit_m,
    )
