// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/Range.</summary>
    public sealed class Range : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.Range; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>0 ultrasound, 1 infrared.</summary>
        public byte RadiationType;

        /// <summary>In rad.</summary>
        public float FieldOfView;

        /// <summary>In m.</summary>
        public float MinRange;

        /// <summary>In m.</summary>
        public float MaxRange;

        /// <summary>The field range, in m; infinite where it is out of bounds (REP 117).</summary>
        public float Value;

        /// <summary>In m^2; 0: unknown.</summary>
        public float Variance;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            to.Write(RadiationType);
            to.Write(FieldOfView);
            to.Write(MinRange);
            to.Write(MaxRange);
            to.Write(Value);
            to.Write(Variance);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            RadiationType = from.ReadByte();
            FieldOfView = from.ReadSingle();
            MinRange = from.ReadSingle();
            MaxRange = from.ReadSingle();
            Value = from.ReadSingle();
            Variance = from.ReadSingle();
        }
    }
}
