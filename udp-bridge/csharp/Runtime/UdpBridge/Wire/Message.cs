// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>A whole message.</summary>
    public sealed class Message
    {
        internal Message(Header header, byte[] body)
        {
            header.PartNumber = 0;
            Header = header;
            Body = body;
        }

        /// <summary>The header of its part 0.</summary>
        public Header Header { get; }

        /// <summary>CDR for types that ROS has; nobody else keeps or changes it.</summary>
        public byte[] Body { get; }
    }
}
