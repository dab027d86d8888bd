// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    /// <summary>The body of type 7: a request of the topic that the header names.</summary>
    public struct Subscribe
    {
        /// <summary>Type of the wanted messages, one with a ROS type.</summary>
        public MessageType WantedType { get; set; }

        /// <summary>False to be sent it no longer.</summary>
        public bool Wanted { get; set; }

        /// <summary>Seconds until the request expires unless it is repeated; 0: until unsubscribed.</summary>
        public ushort LeaseSeconds { get; set; }

        /// <summary>Highest rate wanted in Hz; 0: all.</summary>
        public float MaxRateHz { get; set; }

        /// <summary>Return the 8 bytes of the body.</summary>
        public byte[] Pack()
        {
            var body = new byte[8];
            body[0] = (byte)WantedType;
            body[1] = (byte)(Wanted ? 1 : 0);
            body[2] = unchecked((byte)LeaseSeconds);
            body[3] = (byte)(LeaseSeconds >> 8);
            byte[] rate = BitConverter.GetBytes(MaxRateHz);
            if (!BitConverter.IsLittleEndian) Array.Reverse(rate);
            rate.CopyTo(body, 4);
            return body;
        }

        /// <summary>Read a body; return null, or why it is refused.</summary>
        public static string Parse(byte[] body, out Subscribe to)
        {
            to = new Subscribe();
            return Parse(body, 0, body.Length, out to);
        }

        internal static string Parse(byte[] data, int at, int size, out Subscribe to)
        {
            to = new Subscribe();
            if (size != 8) return "body_size";
            to.WantedType = (MessageType)data[at];
            to.Wanted = data[at + 1] == 1;
            to.LeaseSeconds = (ushort)(data[at + 2] | data[at + 3] << 8);
            var rate = new[] { data[at + 4], data[at + 5], data[at + 6], data[at + 7] };
            if (!BitConverter.IsLittleEndian) Array.Reverse(rate);
            to.MaxRateHz = BitConverter.ToSingle(rate, 0);
            bool isRate = to.MaxRateHz >= 0 && !float.IsInfinity(to.MaxRateHz);
            bool isLegal = Wire.HasRosType(data[at]) && data[at + 1] <= 1 && isRate;
            return isLegal ? null : "body_value";
        }
    }
}
