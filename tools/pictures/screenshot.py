# SPDX-License-Identifier: Apache-2.0
"""Screenshot of Rerun at the end of a recording, without a screen.

`python -m tools.pictures view.png` starts it with a file of `groundlink view --save` and the
picture's name.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

SIZE = "1600x964"
PORT = 9899
MENU_PX = 36
LOADING_S = 15.0
"""Time in which the viewer starts, draws its first picture and hides its notes."""


def screenshot(recording: Path, out: Path, seconds: float) -> None:
    """Play a recording of so many seconds to its end, and write what the viewer shows."""
    rerun = Path(sys.executable).with_name("rerun")
    words = ["--headless", "--port", str(PORT), "--window-size", SIZE]
    # The command starts another process, which would stay.
    with subprocess.Popen([rerun, recording, *words], start_new_session=True) as viewer:
        try:
            time.sleep(LOADING_S + 1.5 * seconds)
            ViewerClient(f"rerun+http://127.0.0.1:{PORT}/proxy").save_screenshot(str(out))
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)
    with Image.open(out) as picture:
        below_the_menu = picture.crop((0, MENU_PX, *picture.size))
    below_the_menu.save(out)


def main(arguments: Sequence[str]) -> None:
    """Write a screenshot."""
    recording, out, seconds = arguments
    screenshot(Path(recording), Path(out), float(seconds))


if __name__ == "__main__":
    main(sys.argv[1:])
