// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    // Identity of a message within its topic.
    internal struct MessageKey
    {
        public readonly uint SeqNumber;
        public readonly long StampNanos;

        public MessageKey(uint seqNumber, long stampNanos)
        {
            SeqNumber = seqNumber;
            StampNanos = stampNanos;
        }

        public bool Is(MessageKey other)
        {
            return SeqNumber == other.SeqNumber && StampNanos == other.StampNanos;
        }
    }
}
