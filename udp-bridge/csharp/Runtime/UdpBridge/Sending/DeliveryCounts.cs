// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>What became of the messages of one topic: Sent = Delivered + Dropped + Incomplete +
    /// Late + Missing + InFlight.</summary>
    public sealed class DeliveryCounts
    {
        /// <summary>Of the messages.</summary>
        public MessageType Type { get; internal set; }

        /// <summary>ROS topic name, as it was sent.</summary>
        public string Topic { get; internal set; }

        /// <summary>Messages that left.</summary>
        public long Sent { get; internal set; }

        /// <summary>Bytes of their bodies.</summary>
        public long SentBytes { get; internal set; }

        /// <summary>Messages that a newer one replaced before they left; not part of Sent.</summary>
        public long Superseded { get; internal set; }

        /// <summary>Messages that reached their user, such as a ROS publisher.</summary>
        public long Delivered { get; internal set; }

        /// <summary>Whole messages that the user did not take, or not in time.</summary>
        public long Dropped { get; internal set; }

        /// <summary>Messages of which parts were lost.</summary>
        public long Incomplete { get; internal set; }

        /// <summary>Whole messages that arrived behind a newer one.</summary>
        public long Late { get; internal set; }

        /// <summary>Messages of which nothing was reported in time.</summary>
        public long Missing { get; internal set; }

        /// <summary>Messages on the path or at the receiver, and those not reported yet.</summary>
        public long InFlight { get; internal set; }

        /// <summary>Bytes of the bodies of the messages delivered.</summary>
        public long DeliveredBytes { get; internal set; }

        /// <summary>The newest report; null before the first. It counts from the receiver's start.
        /// </summary>
        public TopicReport Report { get; internal set; }
    }
}
