// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Net;
using System.Net.Sockets;
using System.Threading;

namespace UdpBridge
{
    /// <summary>One end of a bridge: a socket to one peer, with a thread that sends at the peer's
    /// pace and one that receives, acknowledges and reports. Its methods may be called from any
    /// thread. Errors of the network are counted and not thrown. Datagrams of other addresses are
    /// refused as strangers.</summary>
    public sealed class Link : IDisposable
    {
        private const int WantedBuffer = 8 << 20;
        private const int WaitMillis = 100;  // at which the receiving thread looks at the time
        private const int MostUnread = 1000;
        private const ushort LeaseSeconds = 10;
        private const int LastReports = 3;

        private readonly Socket socket = new Socket(
            AddressFamily.InterNetwork, SocketType.Dgram, ProtocolType.Udp);
        private readonly IPEndPoint peer;
        private readonly object gate = new object();  // guards all that is below
        private readonly SendQueue queue;
        private readonly Receiver receiver;
        private readonly Queue<Message> unread = new Queue<Message>();
        private readonly Dictionary<TopicName, Subscribe> subscriptions
            = new Dictionary<TopicName, Subscribe>();
        private readonly Thread sending, receiving;
        private long errors, strangers, overwritten;
        private bool isClosed;

        /// <summary>Open a socket and start its threads.</summary>
        /// <param name="bind">Where to receive; port 0 takes a free one.</param>
        /// <param name="peer">The other end.</param>
        /// <param name="largest">Bytes of the largest datagram, or a preset of <see cref="Wire"/>:
        /// Loopback for a peer on this host.</param>
        /// <exception cref="SocketException">The address can't be bound.</exception>
        public Link(IPEndPoint bind, IPEndPoint peer, int largest = Wire.Mtu)
        {
            this.peer = peer;
            queue = new SendQueue(largest);
            socket.ReceiveBufferSize = WantedBuffer;
            socket.ReceiveTimeout = WaitMillis;
            socket.Bind(bind);
            receiver = new Receiver(new Limits { ReceiveBuffer = (uint)socket.ReceiveBufferSize });
            receiver.AnswerChallengesOf(peer);
            receiver.OnControl = (from, header, body) => queue.Receive(header, body, NowNanos);
            sending = Start("udp_bridge send", SendAll);
            receiving = Start("udp_bridge receive", ReceiveAll);
        }

        /// <summary>The wall clock in nanoseconds since the POSIX epoch.</summary>
        public static long WallNanos
        {
            get { return (DateTime.UtcNow - new DateTime(1970, 1, 1)).Ticks * 100; }
        }

        /// <summary>Where it receives.</summary>
        public IPEndPoint Address
        {
            get { return (IPEndPoint)socket.LocalEndPoint; }
        }

        /// <summary>Errors of the network, such as a peer's host that can't be reached.</summary>
        public long Errors
        {
            get { return Locked(() => errors); }
        }

        /// <summary>Datagrams from others than the peer.</summary>
        public long Strangers
        {
            get { return Locked(() => strangers); }
        }

        /// <summary>Messages that were received and not read before 1000 newer ones.</summary>
        public long Overwritten
        {
            get { return Locked(() => overwritten); }
        }

        /// <summary>The newest LinkReport of the peer; null before the first.</summary>
        public LinkReport PeerReport
        {
            get { return Locked(() => queue.PeerReport); }
        }

        /// <summary>Return what became of the messages sent, by topic, as the peer reports it.
        /// </summary>
        public List<DeliveryCounts> Deliveries()
        {
            return Locked(() => queue.Deliveries(NowNanos));
        }

        /// <summary>Send a message with a std_msgs/Header.</summary>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="message">The message; it may be changed afterwards.</param>
        /// <returns>False where it can't be sent: it is too large, or a name is.</returns>
        /// <exception cref="CdrException">A string can't be written.</exception>
        public bool Send(string topic, IStampedMessage message)
        {
            Messages.Header header = message.Header;
            return Send(message.Type, topic, header.FrameId, header.Stamp.Nanos, Cdr.Encode(message));
        }

        /// <summary>Send a message without a std_msgs/Header; see the other method.</summary>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="message">The message.</param>
        /// <param name="stampNanos">The value of a Clock, the time of sending of others.</param>
        /// <returns>False where it can't be sent.</returns>
        public bool Send(string topic, IRosMessage message, long stampNanos)
        {
            return Send(message.Type, topic, "", stampNanos, Cdr.Encode(message));
        }

        /// <summary>Send any body; it must not change until it is sent.</summary>
        /// <param name="type">What the body is.</param>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="link">Frame of the data; empty where there is none.</param>
        /// <param name="stampNanos">The instant of measurement, since the POSIX epoch.</param>
        /// <param name="body">The body.</param>
        /// <returns>False where it can't be sent.</returns>
        public bool Send(MessageType type, string topic, string link, long stampNanos, byte[] body)
        {
            lock (gate)
            {
                bool isQueued = queue.Put(type, topic, link, stampNanos, body);
                Monitor.Pulse(gate);
                return isQueued;
            }
        }

        /// <summary>Request a topic of the peer: now, and again each second.</summary>
        /// <param name="type">Of its messages.</param>
        /// <param name="topic">ROS topic name.</param>
        /// <param name="maxRateHz">Highest rate wanted; 0: all.</param>
        public void Subscribe(MessageType type, string topic, float maxRateHz = 0)
        {
            lock (gate)
            {
                subscriptions[new TopicName(type, topic)] = new Subscribe
                {
                    WantedType = type, Wanted = true, LeaseSeconds = LeaseSeconds, MaxRateHz = maxRateHz,
                };
                Renew();
            }
        }

        /// <summary>Return the oldest message that was received and not read yet.</summary>
        /// <param name="message">The message; null where there is none.</param>
        /// <returns>Whether there was one.</returns>
        public bool TryReceive(out Message message)
        {
            lock (gate)
            {
                message = unread.Count > 0 ? unread.Dequeue() : null;
                return message != null;
            }
        }

        /// <summary>Send the last reports and close the socket. What still waits is not sent.
        /// </summary>
        public void Dispose()
        {
            lock (gate)
            {
                if (isClosed) return;
                isClosed = true;
                Monitor.PulseAll(gate);
            }
            sending.Join();
            receiving.Join();
            for (int i = 0; i < LastReports; ++i) receiver.Report(NowNanos, WallNanos, Reply);
            socket.Close();
        }

        private static long NowNanos
        {
            get { return (long)(Stopwatch.GetTimestamp() * (1e9 / Stopwatch.Frequency)); }
        }

        private static Thread Start(string name, ThreadStart work)
        {
            var thread = new Thread(work) { Name = name, IsBackground = true };
            thread.Start();
            return thread;
        }

        private void SendAll()
        {
            var datagram = new byte[Wire.LargestDatagram];
            while (true)
            {
                int size;
                lock (gate)
                {
                    if (isClosed) return;
                    long nowNanos = NowNanos;
                    size = queue.Next(datagram, nowNanos);
                    if (size == 0)
                    {
                        long waitNanos = Math.Min(queue.NextWake(nowNanos) - nowNanos, Wire.Nanos);
                        Monitor.Wait(gate, (int)Math.Max(1, waitNanos / 1000000));
                        continue;
                    }
                }
                Emit(datagram, size);
            }
        }

        private void ReceiveAll()
        {
            var datagram = new byte[65536];
            long reportNanos = NowNanos;
            while (true)
            {
                EndPoint from = new IPEndPoint(IPAddress.Any, 0);
                int size = Wait(datagram, ref from);
                lock (gate)
                {
                    if (isClosed) return;
                    if (size >= 0) Take(datagram, size, from);
                    if (NowNanos < reportNanos) continue;
                    reportNanos = NowNanos + Wire.Nanos;
                    receiver.Report(NowNanos, WallNanos, Reply);
                    Renew();
                }
            }
        }

        // Return the bytes of the next datagram; -1 where none came in time.
        private int Wait(byte[] datagram, ref EndPoint from)
        {
            try
            {
                return socket.ReceiveFrom(datagram, ref from);
            }
            catch (SocketException error)
            {
                bool isTimeout = error.SocketErrorCode == SocketError.TimedOut
                    || error.SocketErrorCode == SocketError.WouldBlock;
                if (!isTimeout) CountError();  // such as the peer's host saying that its port is closed
                return -1;
            }
        }

        private void Take(byte[] datagram, int size, EndPoint from)
        {
            if (!from.Equals(peer))
            {
                ++strangers;
                return;
            }
            byte[] credit;
            Message message = receiver.Receive(datagram, size, peer, NowNanos, out credit);
            if (credit != null) Reply(peer, credit);
            Monitor.Pulse(gate);  // a Credit makes room
            if (message == null) return;
            unread.Enqueue(message);
            if (unread.Count <= MostUnread) return;
            unread.Dequeue();
            ++overwritten;
        }

        private void Renew()
        {
            foreach (KeyValuePair<TopicName, Subscribe> wanted in subscriptions)
            {
                string topic = wanted.Key.Topic;
                queue.Put(MessageType.Subscribe, topic, "", WallNanos, wanted.Value.Pack());
            }
            Monitor.Pulse(gate);
        }

        private void Reply(object to, byte[] datagram)
        {
            Emit(datagram, datagram.Length);
        }

        private void Emit(byte[] datagram, int size)
        {
            try
            {
                socket.SendTo(datagram, size, SocketFlags.None, peer);
            }
            catch (SocketException)
            {
                CountError();
            }
        }

        private void CountError()
        {
            lock (gate) ++errors;
        }

        private T Locked<T>(Func<T> read)
        {
            lock (gate) return read();
        }
    }
}
