// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    // Identity of a topic, besides its sender.
    internal struct TopicName : IEquatable<TopicName>
    {
        public readonly MessageType Type;
        public readonly string Topic;

        public TopicName(MessageType type, string topic)
        {
            Type = type;
            Topic = topic;
        }

        public bool Equals(TopicName other)
        {
            return Type == other.Type && Topic == other.Topic;
        }

        public override bool Equals(object other)
        {
            return other is TopicName && Equals((TopicName)other);
        }

        public override int GetHashCode()
        {
            return unchecked(Topic.GetHashCode() * 31 + (int)Type);
        }
    }
}
