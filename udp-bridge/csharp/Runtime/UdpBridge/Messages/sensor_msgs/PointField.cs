// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/PointField: a field of the records of a cloud.</summary>
    public sealed class PointField
    {
        /// <summary>Datatype of a uint16.</summary>
        public const byte UInt16 = 4;

        /// <summary>Datatype of a float32.</summary>
        public const byte Float32 = 7;

        // Of the shortest one in CDR.
        internal const int LeastBytes = 13;

        /// <summary>Such as x, intensity or ring.</summary>
        public string Name = "";

        /// <summary>Bytes from the beginning of a record.</summary>
        public uint Offset;

        /// <summary>1..8: INT8, UINT8, INT16, UINT16, INT32, UINT32, FLOAT32, FLOAT64.</summary>
        public byte Datatype;

        /// <summary>Elements of the field.</summary>
        public uint Count;

        internal void Write(CdrWriter to)
        {
            to.Write(Name);
            to.Write(Offset);
            to.Write(Datatype);
            to.Write(Count);
        }

        internal void Read(CdrReader from)
        {
            Name = from.ReadString();
            Offset = from.ReadUInt32();
            Datatype = from.ReadByte();
            Count = from.ReadUInt32();
        }
    }
}
