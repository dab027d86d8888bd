// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>A ROS message with a std_msgs/Header, whose stamp and frame_id the datagram's header
    /// repeats.</summary>
    public interface IStampedMessage : IRosMessage
    {
        /// <summary>Stamp and frame.</summary>
        Messages.Header Header { get; }
    }
}
