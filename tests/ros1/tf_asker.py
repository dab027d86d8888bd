# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 user's look at the tf tree: ``tf_asker.py TARGET SOURCE SECONDS``, by the real tf2.

Waits until so many seconds of transforms are there, asks for the way from SOURCE to TARGET at 100
stamps of them, and prints as JSON how many were found, the first complaint, and all frames.
"""

import json
import sys

import rospy
import tf2_ros
import yaml

target, source, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
rospy.init_node("tf_asker")
buffer = tf2_ros.Buffer(cache_time=rospy.Duration(60))
listener = tf2_ros.TransformListener(buffer)
print("ready", flush=True)


def newest() -> float:
    try:
        return float(buffer.get_latest_common_time(target, source).to_sec())
    except tf2_ros.TransformException:
        return 0.0


while not rospy.is_shutdown() and not newest():
    rospy.rostime.wallsleep(0.05)
begin = newest()
while not rospy.is_shutdown() and newest() < begin + seconds:
    rospy.rostime.wallsleep(0.05)
found, complaint = 0, ""
end = newest()
for i in range(100):
    stamp = rospy.Time.from_sec(end - seconds * i / 100)
    try:
        buffer.lookup_transform(target, source, stamp)
        found += 1
    except tf2_ros.TransformException as error:
        complaint = complaint or str(error)
frames = yaml.safe_load(buffer.all_frames_as_yaml())
parents = {child: row["parent"] for child, row in frames.items()}
print(json.dumps(["tf", 0, [found, complaint, parents]]), flush=True)
rospy.spin()
