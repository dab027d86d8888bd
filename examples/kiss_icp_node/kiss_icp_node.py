# SPDX-License-Identifier: Apache-2.0
"""KISS-ICP as a ROS 2 node: subscribes to point clouds, publishes the odometry of the LiDAR.

    python kiss_icp_node.py [--ros-args -p points:=/points -p odometry:=/lidar_odometry]

`-p lowest_m:=-1.0` leaves out points lower than that in the LiDAR's frame. A LiDAR with few rings
sees flat ground as circles that move with the vehicle and hold the estimate back.

The odometry has the frame `lidar_odom`, which is the LiDAR's frame at the first cloud. A pose holds
at the end of its revolution, so that is its stamp.
"""

import numpy as np
import rclpy
from geometry_msgs.msg import Quaternion
from kiss_icp.config import load_config
from kiss_icp.kiss_icp import KissICP
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

Floats = NDArray[np.float64]

FRAME = "lidar_odom"
FLOAT32 = 7
"""sensor_msgs/PointField's."""


class KissIcpNode(Node):
    """Registers each cloud in the local map of KISS-ICP."""

    def __init__(self) -> None:
        super().__init__("kiss_icp")
        self.declare_parameter("points", "/points")
        self.declare_parameter("odometry", "/lidar_odometry")
        self.declare_parameter("lowest_m", -np.inf)
        config = load_config(None)
        config.data.min_range = 0.5
        config.data.deskew = True
        self._kiss_icp = KissICP(config=config)
        self._lowest_m = self.get_parameter("lowest_m").value
        points, odometry = (self.get_parameter(name).value for name in ("points", "odometry"))
        self._publisher = self.create_publisher(Odometry, odometry, 10)
        self.create_subscription(PointCloud2, points, self._register, 10)
        self.get_logger().info(f"{points} -> {odometry}")

    def _register(self, cloud: PointCloud2) -> None:
        xyz, seconds = points_and_times(cloud)
        kept = xyz[:, 2] > self._lowest_m
        self._kiss_icp.register_frame(xyz[kept], seconds[kept])
        self._publisher.publish(odometry_of(self._kiss_icp.last_pose, cloud, seconds.max()))


def points_and_times(cloud: PointCloud2) -> tuple[Floats, Floats]:
    """Return points, shape (N, 3), and seconds after the stamp, shape (N,)."""
    fields = {field.name: field for field in cloud.fields if field.datatype == FLOAT32}
    names = ["x", "y", "z", "time"]
    record = np.dtype(
        {
            "names": names,
            "formats": ["<f4"] * len(names),
            "offsets": [fields[name].offset for name in names],
            "itemsize": cloud.point_step,
        }
    )
    points = np.frombuffer(cloud.data, record)
    xyz = np.stack([points[name] for name in "xyz"], axis=1)
    return xyz.astype(np.float64), points["time"].astype(np.float64)


def odometry_of(pose: Floats, cloud: PointCloud2, after_s: float) -> Odometry:
    """Return a pose, shape (4, 4), as a message with the stamp of the cloud's last point."""
    message = Odometry()
    nanos = cloud.header.stamp.nanosec + round(after_s * 1e9)
    message.header.stamp.sec = cloud.header.stamp.sec + nanos // 1_000_000_000
    message.header.stamp.nanosec = nanos % 1_000_000_000
    message.header.frame_id = FRAME
    message.child_frame_id = cloud.header.frame_id
    place = message.pose.pose.position
    place.x, place.y, place.z = pose[:3, 3].tolist()
    message.pose.pose.orientation = quaternion(pose[:3, :3])
    return message


def quaternion(rotation: Floats) -> Quaternion:
    """Return a rotation matrix as a unit quaternion (Shepperd's method)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    products = np.array(  # four times the products of all pairs of components, in the order x y z w
        [
            [1 + xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy],
            [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
        ]
    )
    row = products[np.argmax(np.diag(products))]  # of the largest component, so of the least error
    x, y, z, w = (row / np.linalg.norm(row)).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(KissIcpNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
