// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    /// <summary>Joins the datagrams of any number of senders into messages, and gives Credit for
    /// them. For one thread at a time.</summary>
    public sealed class Receiver
    {
        private const long ReportedNanos = 5 * Wire.Nanos;  // behind a sender's last datagram

        private readonly Limits limits;
        private readonly Dictionary<object, Peer> peers = new Dictionary<object, Peer>();
        private readonly HashSet<object> challengers = new HashSet<object>();
        private readonly LinkedList<OpenMessage> oldest = new LinkedList<OpenMessage>();
        private int topics;
        private long heard;

        /// <summary>Begin with nothing.</summary>
        /// <param name="limits">What to spend at most; null for the usual.</param>
        public Receiver(Limits limits = null)
        {
            this.limits = limits ?? new Limits();
        }

        /// <summary>What became of all that came.</summary>
        public Counters Counters { get; } = new Counters();

        /// <summary>Announced size of all open messages in bytes.</summary>
        public long MemoryBytes { get; private set; }

        /// <summary>Called with each valid Control datagram: its sender, header and body, which the
        /// buffer holds only during the call. A program that sends passes it to
        /// <see cref="SendQueue.Receive"/>.</summary>
        public Action<object, Header, ArraySegment<byte>> OnControl { get; set; }

        /// <summary>Take one datagram; return the message that it completed, or null.</summary>
        /// <param name="data">A buffer with the datagram at its beginning, which may be used again
        /// afterwards.</param>
        /// <param name="size">Bytes of the datagram.</param>
        /// <param name="sender">Who sent it, such as an EndPoint: equal for equal senders.</param>
        /// <param name="nowNanos">A clock that never goes back.</param>
        /// <param name="credit">A datagram to be sent back to the sender, or null: a Credit, or
        /// the answer to an AddressChallenge.</param>
        public Message Receive(byte[] data, int size, object sender, long nowNanos, out byte[] credit)
        {
            credit = null;
            ++Counters.Datagrams;
            Counters.Bytes += size;
            Header header;
            int at;
            string refusal = Header.Parse(data, size, out header, out at);
            if (refusal == null)
            {
                Expire(nowNanos);
                var datagram = new Datagram(header, data, at, size, sender, nowNanos);
                Message message = null;
                refusal = header.Type == MessageType.Control
                    ? Answer(datagram, out credit)
                    : Accept(datagram, out message, out credit);
                if (refusal == null) return message;
            }
            Counters.Refuse(refusal);
            return null;
        }

        /// <summary>Tell the senders that were heard within the last 5 s what became of their
        /// messages: one TopicReport for each topic, and a LinkReport. Call it once a second, and
        /// three times at the end. A message counts as published when <see cref="Receive"/> returned it.</summary>
        /// <param name="nowNanos">Of the clock of <see cref="Receive"/>.</param>
        /// <param name="wallNanos">The wall clock in nanoseconds since the POSIX epoch.</param>
        /// <param name="send">Called with the sender and a datagram for it.</param>
        public void Report(long nowNanos, long wallNanos, Action<object, byte[]> send)
        {
            Expire(nowNanos);
            foreach (KeyValuePair<object, Peer> peer in peers)
            {
                if (nowNanos - peer.Value.HeardNanos > ReportedNanos) continue;
                foreach (KeyValuePair<TopicName, ReceivedTopic> row in peer.Value.Topics)
                {
                    ReceivedTopic topic = row.Value;
                    var header = new Header { Topic = row.Key.Topic, Link = topic.Link };
                    header.SetStamp(wallNanos);
                    TopicReport report = topic.DeliveryLog.Report(
                        row.Key.Type, topic.Duplicates, nowNanos, wallNanos);
                    send(peer.Key, Control(peer.Value, header, report.Pack()));
                }
                var own = new Header { Topic = "", Link = "" };
                own.SetStamp(wallNanos);
                send(peer.Key, Control(peer.Value, own, LinkReport()));
            }
        }

        /// <summary>From now on answer the AddressChallenges of a peer: one that messages are sent
        /// to, Subscribe included (PROTOCOL.md, section 11). Challenges of others are ignored.
        /// </summary>
        public void AnswerChallengesOf(object peer)
        {
            challengers.Add(peer);
        }

        /// <summary>Give up the messages whose time is over; call it now and then while nothing
        /// comes.</summary>
        public void Expire(long nowNanos)
        {
            while (oldest.Count > 0 && oldest.First.Value.SinceNanos <= nowNanos - limits.TimeLimitNanos)
            {
                GiveUp(oldest.First.Value);
            }
        }

        /// <summary>Count every open message as incomplete, as at an end.</summary>
        public void GiveUpAll()
        {
            while (oldest.Count > 0) GiveUp(oldest.First.Value);
        }

        private string Accept(Datagram d, out Message message, out byte[] credit)
        {
            message = null;
            credit = null;
            bool isSingle = d.Header.PartsMax == 1;
            if (!isSingle && d.PartSize == 0) return "part_size";
            if (d.Header.Type == MessageType.Subscribe)
            {
                if (!isSingle) return "parts_max";
                Subscribe ignored;
                string bad = Subscribe.Parse(d.Data, d.At, d.PartSize, out ignored);
                if (bad != null) return bad;
            }
            string refusal = Check(d);
            if (refusal != null) return refusal;
            Peer peer = PeerOf(d);
            ReceivedTopic topic = TopicOf(peer, d.Topic);
            if (topic.IsRestartBySilence(d)) Forget(topic, long.MaxValue);
            if (topic.IsFinished(d.Key))
            {
                ++Counters.Duplicates;
                ++topic.Duplicates;
                credit = CreditIfDue(peer, d, d.IsLast);
                return null;
            }
            if (topic.IsJump(d.Key) && topic.Find(d.Key) == null)
            {
                if (!topic.IsSecond(d.Header.SeqNumber))
                {
                    bool isNew = topic.Suspect != d.Header.SeqNumber;
                    topic.Suspect = d.Header.SeqNumber;
                    if (isNew) ++Counters.Late;
                    credit = CreditIfDue(peer, d, isNew || d.IsLast);
                    return null;
                }
                Counters.Missing += Math.Max(0, topic.AheadBy(d.Header.SeqNumber) - 1);
                Forget(topic, long.MaxValue);
            }
            topic.Link = d.Header.Link;
            topic.DeliveryLog.Seen(d.Key.SeqNumber, d.Key.StampNanos);
            if (isSingle)
            {
                var body = new byte[d.PartSize];
                Buffer.BlockCopy(d.Data, d.At, body, 0, body.Length);
                message = Finish(topic, d, body);
                return null;
            }
            OpenMessage open = topic.Find(d.Key) ?? Begin(peer, topic, d);
            if (open.Came[d.Header.PartNumber])
            {
                ++Counters.Duplicates;
                ++topic.Duplicates;
                credit = CreditIfDue(peer, d, d.IsLast);
                return null;
            }
            refusal = Place(open, d);
            Announce(open);
            bool isWhole = open.Parts == d.Header.PartsMax;
            if (isWhole)
            {
                Release(open);
                byte[] body = open.Body;
                Array.Resize(ref body, open.PartSize * (d.Header.PartsMax - 1) + open.LastSize);
                message = Finish(topic, d, body);
            }
            else
            {
                KeepBounds(open);
            }
            credit = CreditIfDue(peer, d, isWhole || d.IsLast);
            return refusal;
        }

        // Refuse a part that contradicts its message, before it changes anything.
        private string Check(Datagram d)
        {
            Peer peer;
            ReceivedTopic topic;
            if (!peers.TryGetValue(d.Sender, out peer)) return null;
            if (!peer.Topics.TryGetValue(d.Topic, out topic)) return null;
            if (topic.IsRestartBySilence(d)) return null;  // nothing stays open
            OpenMessage open = topic.Find(d.Key);
            if (open == null) return null;
            if (open.Header.PartsMax != d.Header.PartsMax) return "parts_max";
            if (open.Header.Link != d.Header.Link) return "link";
            if (open.Came[d.Header.PartNumber] || open.PartSize == 0) return null;
            bool fits = d.PartSize == open.PartSize || (d.IsLast && d.PartSize < open.PartSize);
            return fits ? null : "part_size";
        }

        private OpenMessage Begin(Peer peer, ReceivedTopic topic, Datagram d)
        {
            while (topic.Open.Count >= limits.OpenPerTopic) GiveUp(topic.Open[0]);
            var open = new OpenMessage
            {
                Header = d.Header,
                Key = d.Key,
                Peer = peer,
                Topic = topic,
                SinceNanos = d.NowNanos,
                Came = new bool[d.Header.PartsMax],
            };
            topic.Open.Add(open);
            open.Place = oldest.AddLast(open);
            return open;
        }

        // Put a part where it belongs; the first one that is not the last fixes the part size.
        // Return why the last part, which had come before, is refused now.
        private static string Place(OpenMessage open, Datagram d)
        {
            string refusal = null;
            int last = d.Header.PartsMax - 1;
            open.Came[d.Header.PartNumber] = true;
            ++open.Parts;
            if (d.IsLast) open.LastSize = d.PartSize;
            if (open.PartSize == 0)
            {
                if (d.IsLast)  // kept aside until another one says how large parts are
                {
                    open.Last = new byte[d.PartSize];
                    Buffer.BlockCopy(d.Data, d.At, open.Last, 0, d.PartSize);
                    return null;
                }
                open.PartSize = d.PartSize;
                open.Body = new byte[d.PartSize * d.Header.PartsMax];
                if (open.Last != null && open.LastSize > open.PartSize)
                {
                    open.Came[last] = false;  // a right one may still come
                    --open.Parts;
                    refusal = "part_size";
                }
                else if (open.Last != null)
                {
                    Buffer.BlockCopy(open.Last, 0, open.Body, last * open.PartSize, open.LastSize);
                }
                open.Last = null;
            }
            int at = d.Header.PartNumber * open.PartSize;
            Buffer.BlockCopy(d.Data, d.At, open.Body, at, d.PartSize);
            return refusal;
        }

        private Message Finish(ReceivedTopic topic, Datagram d, byte[] body)
        {
            topic.Finish(d.Key);
            int ahead = topic.AheadBy(d.Header.SeqNumber);
            if (ahead > 0 && topic.IsStale(d) && !topic.IsSecond(d.Header.SeqNumber))
            {
                topic.Suspect = d.Header.SeqNumber;
                ++Counters.Late;
                topic.DeliveryLog.Settle(d.Key.SeqNumber, DeliveryLog.Result.Late);
                return null;
            }
            else if (ahead > 0)
            {
                Counters.Missing += ahead - 1;
            }
            else if (d.Header.StampNanos <= topic.LastHanded.StampNanos)
            {
                ++Counters.Late;
                topic.DeliveryLog.Settle(d.Key.SeqNumber, DeliveryLog.Result.Late);
                return null;
            }
            else
            {
                Forget(topic, d.Header.StampNanos);
                topic.DeliveryLog.Seen(d.Key.SeqNumber, d.Key.StampNanos);
                topic.Finish(d.Key);
            }
            topic.HasHanded = true;
            topic.LastHanded = d.Key;
            topic.LastHandedNanos = d.NowNanos;
            topic.Suspect = null;
            ++Counters.Messages;
            topic.DeliveryLog.Publish(d.Key.SeqNumber, d.Key.StampNanos, body.Length, d.NowNanos);
            return new Message(d.Header, body);
        }

        // Begin a topic anew, as for a sender never heard of; older open messages go.
        private void Forget(ReceivedTopic topic, long beforeNanos)
        {
            foreach (OpenMessage open in topic.Open.ToArray())
            {
                if (open.Key.StampNanos < beforeNanos) GiveUp(open);
            }
            topic.HasHanded = false;
            topic.Suspect = null;
            topic.Finished.Clear();
            topic.DeliveryLog = new DeliveryLog();
        }

        private void Announce(OpenMessage open)
        {
            long size = open.PartSize != 0 ? open.PartSize : open.LastSize;
            long more = size * open.Header.PartsMax - open.Announced;
            open.Announced += more;
            open.Peer.MemoryBytes += more;
            MemoryBytes += more;
        }

        private void KeepBounds(OpenMessage open)
        {
            Peer peer = open.Peer;
            while (peer.MemoryBytes > limits.MemoryBytes / 4) GiveUpOldest(peer);
            while (MemoryBytes > limits.MemoryBytes)
            {
                // Who holds nothing else to give takes from the one who holds the most.
                bool hasOthers = peer.MemoryBytes > open.Announced;
                GiveUpOldest(hasOthers ? peer : Best(peers.Values, p => p.MemoryBytes));
            }
        }

        private void GiveUpOldest(Peer peer)
        {
            foreach (OpenMessage open in oldest)
            {
                if (open.Peer != peer) continue;
                GiveUp(open);
                return;
            }
        }

        private void GiveUp(OpenMessage open)
        {
            open.Topic.Finish(open.Key);
            ++Counters.Incomplete;
            open.Topic.DeliveryLog.Settle(open.Key.SeqNumber, DeliveryLog.Result.Incomplete);
            Release(open);
        }

        private void Release(OpenMessage open)
        {
            open.Peer.MemoryBytes -= open.Announced;
            MemoryBytes -= open.Announced;
            oldest.Remove(open.Place);
            open.Topic.Open.Remove(open);
        }

        private Peer PeerOf(Datagram d)
        {
            Peer peer;
            if (!peers.TryGetValue(d.Sender, out peer))
            {
                if (peers.Count >= limits.Senders)
                {
                    KeyValuePair<object, Peer> silent = Best(peers, p => -p.Value.Heard);
                    while (silent.Value.Topics.Count > 0) ForgetTopic(silent.Value);
                    peers.Remove(silent.Key);
                }
                peers[d.Sender] = peer = new Peer();
            }
            peer.Heard = ++heard;
            peer.HeardNanos = d.NowNanos;
            return peer;
        }

        private ReceivedTopic TopicOf(Peer peer, TopicName name)
        {
            ReceivedTopic topic;
            if (!peer.Topics.TryGetValue(name, out topic))
            {
                if (topics >= limits.Topics)
                {
                    // Its own oldest; a newcomer takes from the one who holds the most.
                    bool hasOthers = peer.Topics.Count > 0;
                    ForgetTopic(hasOthers ? peer : Best(peers.Values, p => p.Topics.Count));
                }
                peer.Topics[name] = topic = new ReceivedTopic();
                ++topics;
            }
            topic.Heard = ++heard;
            return topic;
        }

        private void ForgetTopic(Peer peer)
        {
            KeyValuePair<TopicName, ReceivedTopic> silent = Best(peer.Topics, t => -t.Value.Heard);
            foreach (OpenMessage open in silent.Value.Open.ToArray()) GiveUp(open);
            peer.Topics.Remove(silent.Key);
            --topics;
        }

        private static T Best<T>(IEnumerable<T> all, Func<T, long> measure)
        {
            T best = default(T);
            long most = long.MinValue;
            foreach (T one in all)
            {
                long measured = measure(one);
                if (measured <= most) continue;
                most = measured;
                best = one;
            }
            return best;
        }

        // Of Control CreditRequest asks something of a receiver, and AddressChallenge of a sender.
        private string Answer(Datagram d, out byte[] credit)
        {
            credit = null;
            if (d.Header.PartsMax != 1) return d.PartSize == 0 ? "part_size" : "parts_max";
            string refusal = ControlBody.Check(d.Data, d.At, d.PartSize);
            if (refusal != null) return refusal;
            OnControl?.Invoke(d.Sender, d.Header, new ArraySegment<byte>(d.Data, d.At, d.PartSize));
            byte kind = d.Data[d.At];
            if (kind == ControlBody.CreditRequest) credit = Credit(PeerOf(d), d.Header);
            if (kind == ControlBody.AddressChallenge && challengers.Contains(d.Sender))
            {
                var response = new byte[d.PartSize];
                Buffer.BlockCopy(d.Data, d.At, response, 0, response.Length);
                response[0] = ControlBody.AddressResponse;
                credit = Control(PeerOf(d), new Header { Topic = "", Link = "" }, response);
            }
            return null;
        }

        // Acknowledge a datagram where that is due, or an eighth of the buffer was taken since the
        // last. Kernels round small buffers up.
        private byte[] CreditIfDue(Peer peer, Datagram d, bool isDue)
        {
            if (d.Header.PartsMax == 1) return null;
            peer.UncreditedBytes += d.Size + 1024 + (d.Size <= 16384 ? d.Size : 0);
            bool isMuch = peer.UncreditedBytes > limits.ReceiveBuffer / 8;
            return isDue || isMuch ? Credit(peer, d.Header) : null;
        }

        private byte[] Credit(Peer peer, Header of)
        {
            peer.UncreditedBytes = 0;
            var body = new byte[ControlBody.CreditSize];
            body[1] = (byte)of.Type;
            body[2] = of.PartNumber;
            Wire.WriteU32(body, 4, of.SeqNumber);
            Wire.WriteU32(body, 8, limits.ReceiveBuffer);
            of.Link = "";
            return Control(peer, of, body);
        }

        private byte[] LinkReport()
        {
            var report = new LinkReport
            {
                ReceiveBuffer = limits.ReceiveBuffer,
                Datagrams = (ulong)Counters.Datagrams,
                Bytes = (ulong)Counters.Bytes,
            };
            report.AddReasons(Counters.Refused);
            return report.Pack();
        }

        // Return a datagram to a peer, with topic, link and stamp of a header.
        private static byte[] Control(Peer peer, Header header, byte[] body)
        {
            header.Type = MessageType.Control;
            header.SeqNumber = unchecked(peer.Controls++);
            header.PartNumber = 0;
            header.PartsMax = 1;
            var datagram = new byte[256 + body.Length];
            int at = header.Pack(datagram);
            body.CopyTo(datagram, at);
            Array.Resize(ref datagram, at + body.Length);
            return datagram;
        }
    }
}
