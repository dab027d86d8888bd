// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>A ROS message that is the body of a message of the bridge.</summary>
    public interface IRosMessage
    {
        /// <summary>Its number on the wire.</summary>
        MessageType Type { get; }

        /// <summary>Write all fields in the order of their definition.</summary>
        void Write(CdrWriter to);

        /// <summary>Read all fields. Throws <see cref="CdrException"/> where the body ends before
        /// they do.</summary>
        void Read(CdrReader from);
    }
}
