# SPDX-License-Identifier: Apache-2.0
"""What a PointCloud2 holds as one number: the same of ROS 1's object, ROS 2's and rosbags'."""

import json
import zlib
from typing import Any


def cloud_digest(message: Any) -> int:
    """Return a sum over all fields but ROS 1's `seq`."""
    stamp = message.header.stamp
    seconds = stamp.secs if hasattr(stamp, "secs") else stamp.sec
    nanos = stamp.nsecs if hasattr(stamp, "nsecs") else stamp.nanosec
    fields = [[f.name, f.offset, f.datatype, f.count] for f in message.fields]
    shape = [message.height, message.width, message.point_step, message.row_step]
    said = [int(seconds), int(nanos), message.header.frame_id, *map(int, shape)]
    said += [bool(message.is_bigendian), bool(message.is_dense), fields]
    return zlib.crc32(bytes(message.data), zlib.crc32(json.dumps(said).encode()))
