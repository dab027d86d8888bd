// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    // A datagram whose header was read, with its sender and the time of its arrival.
    internal struct Datagram
    {
        public readonly Header Header;
        public readonly byte[] Data;
        public readonly int At, Size;
        public readonly object Sender;
        public readonly long NowNanos;

        public Datagram(Header header, byte[] data, int at, int size, object sender, long nowNanos)
        {
            Header = header;
            Data = data;
            At = at;
            Size = size;
            Sender = sender;
            NowNanos = nowNanos;
        }

        public int PartSize
        {
            get { return Size - At; }
        }

        public bool IsLast
        {
            get { return Header.PartNumber + 1 == Header.PartsMax; }
        }

        public TopicName Topic
        {
            get { return new TopicName(Header.Type, Header.Topic); }
        }

        public MessageKey Key
        {
            get { return new MessageKey(Header.SeqNumber, Header.StampNanos); }
        }
    }
}
