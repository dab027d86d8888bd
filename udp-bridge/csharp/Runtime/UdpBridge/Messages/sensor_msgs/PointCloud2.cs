// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/PointCloud2: points as records of bytes.</summary>
    public sealed class PointCloud2 : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.PointCloud2; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>Rows; 1 where the points have no order.</summary>
        public uint Height;

        /// <summary>Points of a row.</summary>
        public uint Width;

        /// <summary>What a record holds.</summary>
        public PointField[] Fields = new PointField[0];

        /// <summary>Order of bytes in the records.</summary>
        public bool IsBigendian;

        /// <summary>Bytes of a record.</summary>
        public uint PointStep;

        /// <summary>Bytes of a row.</summary>
        public uint RowStep;

        /// <summary>RowStep * Height bytes.</summary>
        public byte[] Data = new byte[0];

        /// <summary>Whether no point is invalid.</summary>
        public bool IsDense;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            to.Write(Height);
            to.Write(Width);
            to.Write((uint)Fields.Length);
            foreach (PointField field in Fields) field.Write(to);
            to.Write(IsBigendian);
            to.Write(PointStep);
            to.Write(RowStep);
            to.Write(Data);
            to.Write(IsDense);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Height = from.ReadUInt32();
            Width = from.ReadUInt32();
            Fields = new PointField[from.ReadCount(PointField.LeastBytes)];
            for (int i = 0; i < Fields.Length; ++i)
            {
                Fields[i] = new PointField();
                Fields[i].Read(from);
            }
            IsBigendian = from.ReadBoolean();
            PointStep = from.ReadUInt32();
            RowStep = from.ReadUInt32();
            Data = from.ReadBytes();
            IsDense = from.ReadBoolean();
        }
    }
}
