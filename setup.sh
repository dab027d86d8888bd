#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Create the environment in .venv: Groundlink, UDP Bridge, development tools, and ROS 2 if its wheels
# fit this platform. `setup.sh run` leaves out what a run does not need: development tools, viewers,
# analysis. Uses uv if it is installed, else venv and pip.
set -eu
cd "$(dirname "$0")"
WHAT=${1:-development}

PYTHON=${PYTHON:-}
if [ -z "$PYTHON" ]; then
    for version in 3.11 3.12 3.13; do # the first has wheels of PyBullet
        for candidate in "python$version" python3 python; do
            found=$("$candidate" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || continue
            if [ "$found" = "$version" ]; then
                PYTHON=$candidate
                break 2
            fi
        done
    done
fi

step() { printf '[%s] %s\n' "setup" "$1"; }

if command -v uv >/dev/null 2>&1; then
    step "creating .venv with uv"
    [ -x .venv/bin/python ] || uv venv --quiet --seed --python 3.11 .venv
    install() { uv pip install --quiet --python .venv/bin/python "$@"; }
else
    if [ -z "$PYTHON" ]; then
        echo "setup: no Python 3.11, 3.12 or 3.13 found." \
            "Fix: install Python 3.11, or run: make setup PYTHON=/path/to/python3.11" >&2
        exit 2
    fi
    step "creating .venv with venv and pip"
    [ -x .venv/bin/python ] || "$PYTHON" -m venv .venv
    # A run starts faster with compiled modules; compiling all those for development takes too long.
    [ "$WHAT" = run ] && COMPILE=--compile || COMPILE=--no-compile
    install() { .venv/bin/python -m pip install -qq --disable-pip-version-check $COMPILE "$@"; }
fi

if .venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 12))'; then
    step "PyBullet has no wheels for Python 3.12 and later: compiling it takes about 15 minutes"
fi
if [ "$WHAT" = run ]; then
    step "installing Groundlink and what a run needs (about a minute)"
    install -e ./udp-bridge -e '.[run]'
else
    step "installing Groundlink, its dependencies and test tools (one to two minutes)"
    install -e ./udp-bridge -e '.[all,benchmarks,experiments,docs,dev]'
    # A test decodes packets by its core, which needs numpy alone. It pins older rosbags, click, psutil.
    install --no-deps ouster-sdk==0.16.2 || step "no wheel of ouster-sdk for this platform: its tests are skipped"
fi

# Of PyBullet's wheel, nothing here uses 142 MB of models and 131 MB of debug symbols. What is written
# is another file: package caches may share the old one by hard links.
packages=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("platlib"))')
rm -rf "$packages/pybullet_data"
for library in "$packages"/pybullet.*.so; do
    if strip --strip-unneeded -o "$library.new" "$library" 2>/dev/null; then
        mv "$library.new" "$library"
    fi
done

step "installing ROS 2 Kilted"
if install $(.venv/bin/python - <<'PYTHON'
import tomllib
with open("pyproject.toml", "rb") as file:
    print(*tomllib.load(file)["project"]["optional-dependencies"]["ros2"])
PYTHON
); then
    step "building message packages without wheels: tf2_msgs, groundlink_msgs"
    .venv/bin/python ros/ros2/build_messages.py
    install -e ./ros/ros2/udp_bridge_ros2
else
    step "no ROS 2 wheels for this platform: a plain UDP Bridge receiver replaces the ROS node"
fi

[ "$WHAT" = run ] || touch .venv/.ready
touch .venv/.ready-run
step "done"
