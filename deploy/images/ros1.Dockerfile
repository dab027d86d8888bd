# SPDX-License-Identifier: Apache-2.0
# The ROS 1 node, and roscore: Noetic as Debian 12 has it.

FROM debian:bookworm-slim
RUN apt-get update -q \
 && apt-get install -y -q --no-install-recommends \
    python3-rospy python3-roslaunch python3-rosmaster python3-rostopic python3-rosbag rosout \
    python3-diagnostic-msgs python3-geometry-msgs python3-nav-msgs python3-rosgraph-msgs \
    python3-sensor-msgs python3-std-msgs python3-std-srvs python3-tf2-msgs python3-genpy ros-std-msgs \
 && rm -rf /var/lib/apt/lists/*
COPY udp-bridge/src /opt/udp-bridge
COPY ros/groundlink_msgs /source/groundlink_msgs
COPY ros/ros1/build_messages.py /source/ros1/
COPY ros/ros1/udp_bridge_ros1/src /opt/udp_bridge_ros1
RUN python3 /source/ros1/build_messages.py /usr/local/lib/python3.11/dist-packages
ENV PYTHONPATH=/opt/udp-bridge:/opt/udp_bridge_ros1 PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    HOME=/tmp ROS_HOME=/tmp/ros
USER 65532:65532
EXPOSE 7511/udp 11311/tcp
ENTRYPOINT ["python3", "-m", "udp_bridge_ros1"]
