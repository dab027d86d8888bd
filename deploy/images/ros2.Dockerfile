# SPDX-License-Identifier: Apache-2.0
# The ROS 2 node.

FROM python:3.11-slim-bookworm AS requirements
COPY pyproject.toml .
RUN python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
print(*p["optional-dependencies"]["ros2"], sep="\n")' > /requirements.txt

FROM python:3.11-slim-bookworm AS build
RUN apt-get update -q \
 && apt-get install -y -q --no-install-recommends cmake g++ gcc libc6-dev make \
 && rm -rf /var/lib/apt/lists/*
RUN python -m venv --without-pip /opt/groundlink
WORKDIR /source
COPY --from=requirements /requirements.txt .
RUN --mount=type=cache,target=/root/.cache/pip \
    pip --python /opt/groundlink/bin/python install -q -r requirements.txt
COPY . .
RUN --mount=type=cache,target=/root/.cache/pip \
    /opt/groundlink/bin/python ros/ros2/build_messages.py \
 && pip --python /opt/groundlink/bin/python install -q './udp-bridge[fec]' ./ros/ros2/udp_bridge_ros2

FROM python:3.11-slim-bookworm
COPY --from=build /opt/groundlink /opt/groundlink
ENV PATH=/opt/groundlink/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
USER 65532:65532
EXPOSE 7511/udp
ENTRYPOINT ["python", "-m", "udp_bridge_ros2"]
