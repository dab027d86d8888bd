// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/NavSatStatus.</summary>
    public struct NavSatStatus
    {
        /// <summary>-1 no fix, 0 fix, 1 and 2 augmented by satellites and on the ground.</summary>
        public sbyte Status;

        /// <summary>Bits: 1 GPS, 2 GLONASS, 4 COMPASS, 8 GALILEO.</summary>
        public ushort Service;

        internal void Write(CdrWriter to)
        {
            to.Write(Status);
            to.Write(Service);
        }

        internal void Read(CdrReader from)
        {
            Status = from.ReadSByte();
            Service = from.ReadUInt16();
        }
    }
}
