// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>std_msgs/msg/Header.</summary>
    public sealed class Header
    {
        /// <summary>The instant of measurement.</summary>
        public Time Stamp;

        /// <summary>Frame of the data; empty where there is none.</summary>
        public string FrameId = "";

        internal void Write(CdrWriter to)
        {
            Stamp.Write(to);
            to.Write(FrameId);
        }

        internal void Read(CdrReader from)
        {
            Stamp.Read(from);
            FrameId = from.ReadString();
        }
    }
}
