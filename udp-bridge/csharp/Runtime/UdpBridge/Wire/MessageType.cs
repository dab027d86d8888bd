// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>The types of messages, PROTOCOL.md, section 4, that this version takes.</summary>
    public enum MessageType : byte
    {
        /// <summary>sensor_msgs/msg/PointCloud2, to ROS.</summary>
        PointCloud2 = 1,
        /// <summary>sensor_msgs/msg/Imu, to ROS.</summary>
        Imu = 2,
        /// <summary>sensor_msgs/msg/CompressedImage, to ROS.</summary>
        CompressedImage = 3,
        /// <summary>sensor_msgs/msg/NavSatFix, to ROS.</summary>
        NavSatFix = 4,
        /// <summary>groundlink_msgs/msg/WheelEncoders, to ROS.</summary>
        WheelEncoders = 5,
        /// <summary>sensor_msgs/msg/Range, to ROS.</summary>
        Range = 6,
        /// <summary>The bridge's own.</summary>
        Subscribe = 7,
        /// <summary>rosgraph_msgs/msg/Clock, to ROS.</summary>
        Clock = 8,
        /// <summary>geometry_msgs/msg/Twist, from ROS.</summary>
        Twist = 9,
        /// <summary>geometry_msgs/msg/PoseStamped, both ways.</summary>
        PoseStamped = 10,
        /// <summary>nav_msgs/msg/OccupancyGrid, both ways.</summary>
        OccupancyGrid = 11,
        /// <summary>sensor_msgs/msg/LaserScan, to ROS.</summary>
        LaserScan = 32,
        /// <summary>sensor_msgs/msg/Image, to ROS.</summary>
        Image = 33,
        /// <summary>sensor_msgs/msg/CameraInfo, to ROS.</summary>
        CameraInfo = 34,
        /// <summary>tf2_msgs/msg/TFMessage, to ROS.</summary>
        TFMessage = 35,
        /// <summary>nav_msgs/msg/Odometry, both ways.</summary>
        Odometry = 36,
        /// <summary>sensor_msgs/msg/JointState, both ways.</summary>
        JointState = 37,
        /// <summary>geometry_msgs/msg/TwistStamped, from ROS.</summary>
        TwistStamped = 38,
        /// <summary>std_msgs/msg/String, to ROS.</summary>
        String = 39,
        /// <summary>nav_msgs/msg/Path, from ROS.</summary>
        Path = 40,
        /// <summary>The bridge's own.</summary>
        Control = 64,
        /// <summary>Any ROS type, named in the body, both ways.</summary>
        Typed = 67,
    }
}
