// SPDX-License-Identifier: Apache-2.0

using System.Collections.Generic;

namespace UdpBridge
{
    // A message of which parts are missing.
    internal sealed class OpenMessage
    {
        public Header Header;
        public MessageKey Key;
        public Peer Peer;
        public ReceivedTopic Topic;
        public LinkedListNode<OpenMessage> Place;
        public long SinceNanos, Announced;
        public int Parts, PartSize, LastSize;  // PartSize 0: not known
        public bool[] Came;
        public byte[] Body;  // PartSize * PartsMax bytes, once that is known
        public byte[] Last;  // the last part, where it came before all others
    }
}
