#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes the environment in .venv: the application, the bridge, the tools, and ROS 2 where it fits.
# With uv where it is there, else with venv and pip.
set -eu
cd "$(dirname "$0")"

PYTHON=${PYTHON:-}
if [ -z "$PYTHON" ]; then
    for candidate in python3.11 python3 python; do
        if command -v "$candidate" >/dev/null 2>&1 &&
            "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
            PYTHON=$candidate
            break
        fi
    done
fi

step() { printf '[%s] %s\n' "setup" "$1"; }

if command -v uv >/dev/null 2>&1; then
    step "environment in .venv, by uv"
    [ -x .venv/bin/python ] || uv venv --quiet --python 3.11 .venv
    install() { uv pip install --quiet --python .venv/bin/python "$@"; }
else
    if [ -z "$PYTHON" ]; then
        echo "setup: Python 3.11 was not found (PyBullet has no wheels for newer ones); install it" \
            "or name it: make setup PYTHON=/path/to/python3.11" >&2
        exit 2
    fi
    step "environment in .venv, by venv and pip"
    [ -x .venv/bin/python ] || "$PYTHON" -m venv .venv
    install() { .venv/bin/python -m pip install -qq --disable-pip-version-check "$@"; }
fi

step "Groundlink, PyBullet, Embree, Zenoh, Rerun and the tools of its tests (a minute or two)"
install -e ./udp-bridge -e '.[physics,sensors,camera,gateway,record,report,view,secure,benchmarks,experiments,dev]'

step "ROS 2 Kilted"
if install $(.venv/bin/python - <<'PYTHON'
import tomllib
with open("pyproject.toml", "rb") as file:
    print(*tomllib.load(file)["project"]["optional-dependencies"]["ros2"])
PYTHON
); then
    step "message packages without a wheel: tf2_msgs, groundlink_msgs"
    .venv/bin/python ros/ros2/build_messages.py
    install -e ./ros/ros2/udp_bridge_ros2
else
    step "no ROS 2 wheel fits this platform: a plain receiver will stand in for the ROS node"
fi

touch .venv/.ready
step "done"
