# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.rendering.portrait WHAT --out FILE.png``.

The process joins no run: it loads files, draws once, and ends. `groundlink world show` starts it.
"""

import argparse
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from groundlink.cli.files.world import add_show_arguments
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.process import runner as process

PROCESS = "world show"

FROM_DEG = {
    FileKind.WORLD: (200.0, 38.0),
    FileKind.SCENARIO: (200.0, 38.0),
    FileKind.VEHICLE: (130.0, 27.0),
}
"""Default direction of the eye, in degrees: the sun is behind it, and a vehicle faces east."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Write a picture."""
    parser = argparse.ArgumentParser(prog="groundlink world show", description="Draw a picture.")
    add_show_arguments(parser)
    options = parser.parse_args(arguments)
    with needs("camera"):
        import cv2

        from .picture import portrait

    kind, scenario = load_partial(options.what, warn=_warn)
    out = options.out or Path(f"{Path(options.what).stem}.png")
    picture = portrait(kind, scenario, options.point or FROM_DEG[kind], options.size)
    try:
        out.write_bytes(cv2.imencode(out.suffix.lower(), picture[..., ::-1])[1].tobytes())
    except OSError as error:
        raise UserError(f"--out {out}: {(error.strerror or str(error)).lower()}") from None
    print(out)


def _warn(line: str) -> None:
    print(f"groundlink: warning: {line}", file=sys.stderr)


if __name__ == "__main__":
    process.run(PROCESS, main)
