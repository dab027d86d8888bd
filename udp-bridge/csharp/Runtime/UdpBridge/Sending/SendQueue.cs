// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    /// <summary>Paces the messages to one peer, PROTOCOL.md, section 8: which datagram leaves next,
    /// and when. A message of one part leaves at once; parts of larger ones leave as the peer's
    /// Credits allow, or at a limited rate where it sends none. Of a topic and link only the newest
    /// large message waits. It opens no socket and reads no clock. For one thread at a time.
    /// </summary>
    public sealed class SendQueue
    {
        private const int SmallPerTopic = 512;  // more than a second of a 400 Hz topic

        private readonly int largest;
        private readonly FlowControl flow = new FlowControl();
        private readonly DeliveryCounter delivery = new DeliveryCounter();
        private readonly LinkedList<Waiting> small = new LinkedList<Waiting>();  // by arrival
        private readonly Dictionary<TopicName, Queue<LinkedListNode<Waiting>>> smallOfTopic
            = new Dictionary<TopicName, Queue<LinkedListNode<Waiting>>>();
        private readonly List<Waiting> large = new List<Waiting>();  // one of a topic and link
        private readonly byte[] header = new byte[256];
        private Waiting current;  // the large message that is being sent
        private int upcoming;  // its next part
        private uint requests;

        /// <summary>Begin with nothing.</summary>
        /// <param name="largest">Bytes of the largest datagram, as for <see cref="Sender"/>.</param>
        public SendQueue(int largest)
        {
            this.largest = largest;
        }

        /// <summary>The newest LinkReport of the peer; null before the first.</summary>
        public LinkReport PeerReport { get; private set; }

        /// <summary>Credits that were requested because the peer did not read.</summary>
        public long Stalls
        {
            get { return flow.Stalls; }
        }

        /// <summary>Whether nothing waits.</summary>
        public bool IsIdle
        {
            get { return small.Count == 0 && large.Count == 0 && current == null; }
        }

        /// <summary>Queue a message; its number is given when it leaves.</summary>
        /// <param name="type">What the body is.</param>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="link">Frame of the data; empty where there is none.</param>
        /// <param name="stampNanos">The instant of measurement, since the POSIX epoch.</param>
        /// <param name="body">The body, which must not change until it is sent.</param>
        /// <returns>False where the message can't be sent.</returns>
        public bool Put(MessageType type, string topic, string link, long stampNanos, byte[] body)
        {
            var of = new Header { Type = type, PartsMax = 1, Topic = topic, Link = link };
            if (!of.SetStamp(stampNanos)) return false;
            int headerSize = of.Pack(header);
            if (headerSize == 0) return false;
            int partSize = Sender.PartSize(body.Length, headerSize, largest);
            if (partSize == 0) return false;
            of.PartsMax = (byte)Math.Max(1, (body.Length + partSize - 1) / partSize);
            var message = new Waiting(of, body, partSize);
            if (of.PartsMax == 1) PutSmall(message);
            else PutLarge(message);
            return true;
        }

        /// <summary>Write the next datagram that may leave now.</summary>
        /// <param name="datagram">A buffer of <see cref="Wire.LargestDatagram"/> bytes.</param>
        /// <param name="nowNanos">A clock that never goes back.</param>
        /// <returns>Its bytes; 0 where none may leave before <see cref="NextWake"/> or the next
        /// Credit.</returns>
        public int Next(byte[] datagram, long nowNanos)
        {
            if (small.Count > 0)
            {
                Waiting oldest = PopSmall();
                Number(oldest);
                return oldest.Write(datagram, 0);
            }
            if (!Begin()) return 0;
            int size = current.DatagramSize(upcoming);
            if (flow.IsRequestDue(size, nowNanos)) return RequestCredit(datagram, nowNanos);
            if (!flow.MaySend(size, nowNanos)) return 0;
            current.Write(datagram, upcoming);
            flow.Sent(current.Name, current.Header.SeqNumber, upcoming, size, nowNanos);
            if (++upcoming == current.Header.PartsMax) current = null;
            return size;
        }

        /// <summary>Return when to call <see cref="Next"/> again if no Credit arrives;
        /// <see cref="long.MaxValue"/> where nothing waits.</summary>
        public long NextWake(long nowNanos)
        {
            if (small.Count > 0) return nowNanos;
            return Begin() ? flow.NextWake(current.DatagramSize(upcoming), nowNanos) : long.MaxValue;
        }

        /// <summary>Take a Control message of the peer, as <see cref="Receiver.OnControl"/> hands it
        /// over: a Credit makes room, reports say what became of the messages.</summary>
        public void Receive(Header of, ArraySegment<byte> body, long nowNanos)
        {
            byte[] data = body.Array;
            int at = body.Offset;
            switch (data[at])
            {
                case ControlBody.Credit:
                    var topic = new TopicName((MessageType)data[at + 1], of.Topic);
                    flow.Credited(topic, Wire.ReadU32(data, at + 4), data[at + 2],
                                  Wire.ReadU32(data, at + 8), nowNanos);
                    break;
                case ControlBody.TopicReport:
                    delivery.Reported(of.Topic, TopicReport.Parse(body), of.StampNanos);
                    break;
                case ControlBody.LinkReport:
                    PeerReport = LinkReport.Parse(body);
                    break;
            }
        }

        /// <summary>Return what became of the messages, by topic. Call it about once a second: a
        /// message that was sent 4 s ago and never reported is missing.</summary>
        public List<DeliveryCounts> Deliveries(long nowNanos)
        {
            return delivery.Counts(nowNanos);
        }

        private void PutSmall(Waiting message)
        {
            Queue<LinkedListNode<Waiting>> ofTopic;
            if (!smallOfTopic.TryGetValue(message.Name, out ofTopic))
            {
                smallOfTopic[message.Name] = ofTopic = new Queue<LinkedListNode<Waiting>>();
            }
            if (ofTopic.Count >= SmallPerTopic)
            {
                delivery.Superseded(ofTopic.Peek().Value);
                small.Remove(ofTopic.Dequeue());
            }
            ofTopic.Enqueue(small.AddLast(message));
        }

        private Waiting PopSmall()
        {
            Waiting oldest = small.First.Value;
            small.RemoveFirst();
            smallOfTopic[oldest.Name].Dequeue();
            return oldest;
        }

        private void PutLarge(Waiting message)
        {
            int place = large.FindIndex(message.IsOfTopicAndLink);
            if (place < 0)
            {
                large.Add(message);
                return;
            }
            delivery.Superseded(large[place]);
            large[place] = message;
        }

        // Make the next large message the current one; return whether there is any.
        private bool Begin()
        {
            if (current != null) return true;
            if (large.Count == 0) return false;
            current = large[0];
            upcoming = 0;
            large.RemoveAt(0);
            Number(current);
            return true;
        }

        private void Number(Waiting message)
        {
            message.Header.SeqNumber = delivery.NextNumber(message);
            message.Pack();
        }

        private int RequestCredit(byte[] datagram, long nowNanos)
        {
            var of = new Header
            {
                Type = MessageType.Control, SeqNumber = requests, PartsMax = 1, Topic = "", Link = "",
            };
            int at = of.Pack(datagram);
            Wire.WriteU32(datagram, at, ControlBody.CreditRequest);
            flow.Requested(unchecked(requests++), at + 4, nowNanos);
            return at + 4;
        }
    }
}
