// SPDX-License-Identifier: Apache-2.0

using System.Collections.Generic;

namespace UdpBridge
{
    // What a receiver remembers of one sender.
    internal sealed class Peer
    {
        public readonly Dictionary<TopicName, ReceivedTopic> Topics = new Dictionary<TopicName, ReceivedTopic>();
        public long MemoryBytes, UncreditedBytes, Heard, HeardNanos;
        public uint Controls;
    }
}
