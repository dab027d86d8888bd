// SPDX-License-Identifier: Apache-2.0

using System.Collections.Generic;

namespace UdpBridge
{
    // Numbers the messages to one peer and counts what became of them, PROTOCOL.md, section 6.
    internal sealed class DeliveryCounter
    {
        private readonly Dictionary<TopicName, TopicCounter> topics
            = new Dictionary<TopicName, TopicCounter>();
        private bool isReported;  // A receiver may send no reports: nothing is missing then.

        internal uint NextNumber(Waiting message)
        {
            return Of(message).Send(message.Header.StampNanos, message.Body.Length);
        }

        internal void Superseded(Waiting message)
        {
            Of(message).Supersede();
        }

        internal void Reported(string topic, TopicReport report, long reportedNanos)
        {
            isReported = true;
            TopicCounter counter;
            if (topics.TryGetValue(new TopicName(report.Type, topic), out counter))
            {
                counter.Take(report, reportedNanos);
            }
        }

        internal List<DeliveryCounts> Counts(long nowNanos)
        {
            var all = new List<DeliveryCounts>();
            foreach (KeyValuePair<TopicName, TopicCounter> topic in topics)
            {
                DeliveryCounts counts = topic.Value.Counts(topic.Key, nowNanos, isReported);
                if (Wire.HasRosType((byte)topic.Key.Type)) all.Add(counts);
            }
            return all;
        }

        private TopicCounter Of(Waiting message)
        {
            TopicCounter counter;
            if (!topics.TryGetValue(message.Name, out counter))
            {
                topics[message.Name] = counter = new TopicCounter(message.Header.StampNanos);
            }
            return counter;
        }
    }
}
