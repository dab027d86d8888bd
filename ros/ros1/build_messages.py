# SPDX-License-Identifier: Apache-2.0
"""Build groundlink_msgs for a ROS 1 without catkin: ``python3 ros/ros1/build_messages.py FOLDER``.

The .msg files are the same as for ROS 2; genpy generates the classes. FOLDER must be on the Python
path, such as `/usr/local/lib/python3.11/dist-packages` in Debian 12.
"""

from __future__ import annotations

import sys
from pathlib import Path

PACKAGE = "groundlink_msgs"
MESSAGES = Path(__file__).resolve().parents[1] / PACKAGE / "msg"
STD_MSGS = "/usr/share/std_msgs/msg"
"""Folder with the definition of std_msgs/Header, from Debian's package ros-std-msgs."""


def main(arguments: list[str]) -> int:
    """Build the package; return the exit code."""
    try:
        from genpy.generate_initpy import write_modules
        from genpy.generator import MsgGenerator
    except ImportError as error:
        print(f"build_messages: {error}; install python3-genpy", file=sys.stderr)
        return 2
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print("build_messages: expected one argument, the folder to write to", file=sys.stderr)
        return 2
    into = Path(arguments[0]) / PACKAGE / "msg"
    into.mkdir(parents=True, exist_ok=True)
    files = [str(file) for file in sorted(MESSAGES.glob("*.msg"))]
    search_path = {PACKAGE: [str(MESSAGES)], "std_msgs": [STD_MSGS]}
    code = MsgGenerator().generate_messages(PACKAGE, files, str(into), search_path)
    write_modules(str(into))
    write_modules(str(into.parent))
    return int(code or 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
