// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    // A message that waits to be sent, and how it is cut.
    internal sealed class Waiting
    {
        internal Header Header;  // of part 0; the number is given when the message leaves
        internal readonly byte[] Body;
        internal readonly TopicName Name;
        private readonly byte[] packed = new byte[256];
        private readonly int partSize;
        private int headerSize;

        internal Waiting(Header header, byte[] body, int partSize)
        {
            Header = header;
            Body = body;
            Name = new TopicName(header.Type, header.Topic);
            this.partSize = partSize;
            Pack();
        }

        // Pack the header, again when its number has changed.
        internal void Pack()
        {
            headerSize = Header.Pack(packed);
        }

        internal bool IsOfTopicAndLink(Waiting other)
        {
            return Name.Equals(other.Name) && Header.Link == other.Header.Link;
        }

        internal int DatagramSize(int part)
        {
            return headerSize + Math.Min(partSize, Body.Length - part * partSize);
        }

        // Write the datagram of a part; return its bytes.
        internal int Write(byte[] datagram, int part)
        {
            Buffer.BlockCopy(packed, 0, datagram, 0, headerSize);
            datagram[6] = (byte)part;
            int size = DatagramSize(part);
            Buffer.BlockCopy(Body, part * partSize, datagram, headerSize, size - headerSize);
            return size;
        }
    }
}
