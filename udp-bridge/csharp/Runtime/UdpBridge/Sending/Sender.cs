// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    /// <summary>Cuts messages into datagrams and numbers them. For one thread at a time.</summary>
    public sealed class Sender
    {
        private readonly Dictionary<TopicName, uint> numbers = new Dictionary<TopicName, uint>();
        private readonly byte[] datagram = new byte[Wire.LargestDatagram];

        /// <summary>Send one message.</summary>
        /// <param name="type">What the body is.</param>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="link">Frame of the data; empty where there is none.</param>
        /// <param name="stampNanos">The instant of measurement, since the POSIX epoch.</param>
        /// <param name="body">CDR for types that ROS has, at the beginning of this buffer.</param>
        /// <param name="bodySize">Bytes of the body.</param>
        /// <param name="largest">Bytes of the largest datagram, 256 to 65 507, or a preset of
        /// <see cref="Wire"/>. A message that needs more than 255 parts is cut into larger ones, as
        /// PROTOCOL.md, section 3, has it.</param>
        /// <param name="emit">Called for each datagram, in order, with a buffer that is used again,
        /// and how many of its bytes to send.</param>
        /// <returns>False where the message can't be sent; nothing was sent then.</returns>
        public bool Send(MessageType type, string topic, string link, long stampNanos, byte[] body,
                         int bodySize, int largest, Action<byte[], int> emit)
        {
            var header = new Header { Type = type, PartsMax = 1, Topic = topic, Link = link };
            if (!header.SetStamp(stampNanos)) return false;
            int headerSize = header.Pack(datagram);
            if (headerSize == 0) return false;
            int partSize = PartSize(bodySize, headerSize, largest);
            if (partSize == 0) return false;
            int parts = Math.Max(1, (bodySize + partSize - 1) / partSize);
            var name = new TopicName(type, topic);
            uint number;
            numbers.TryGetValue(name, out number);
            numbers[name] = unchecked(number + 1);
            header.PartsMax = (byte)parts;
            header.SeqNumber = number;
            for (int part = 0; part < parts; ++part)
            {
                header.PartNumber = (byte)part;
                header.Pack(datagram);
                int size = Math.Min(partSize, bodySize - part * partSize);
                Buffer.BlockCopy(body, part * partSize, datagram, headerSize, size);
                emit(datagram, headerSize + size);
            }
            return true;
        }

        /// <summary>Return how many bytes of a body a part carries; 0 where the message fits at no
        /// size.</summary>
        public static int PartSize(int bodySize, int headerSize, int largest)
        {
            bool isSize = largest >= 256 && largest <= Wire.LargestDatagram;
            if (largest != Wire.Loopback && !isSize) return 0;
            int most = Wire.LargestDatagram - headerSize;
            int wanted = isSize ? largest - headerSize : Math.Min(Wire.LoopbackPart, most);
            if (bodySize <= wanted * Wire.MostParts) return wanted;
            for (int size = Wire.Mtu; size < Wire.LargestDatagram; size += 1480)
            {
                if (bodySize <= (size - headerSize) * Wire.MostParts) return size - headerSize;
            }
            return bodySize <= most * Wire.MostParts ? most : 0;
        }
    }
}
