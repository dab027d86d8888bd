// SPDX-License-Identifier: Apache-2.0
// Does on stdin and stdout what the tests ask for, as often as they ask.
//
// 'R' COUNT (NOW_NANOS SENDER SIZE DATAGRAM)...: a new Receiver takes them; a line for each message,
// Credit, report and refusal, and one of counts; SENDER 255 stands for a time to report. 'S' TYPE STAMP TIMES LARGEST TOPIC LINK BODY: a new Sender
// sends that so many times; a line for each datagram of the last time, and whether it was sent.
// 'T' BODY: the ROS type and the offset of a Typed body, or why it is refused.
// 'C' TYPE BODY: a line for each field of the message in the CDR, and the CDR that is written of it, or
// that it is refused.
// 'Q' LARGEST COUNT (OPERATION NOW_NANOS ...)...: a SendQueue; 'p' TYPE STAMP TOPIC LINK BODY queues a
// message, 'n' takes what may leave, 'c' DATAGRAM is of the peer, 'd' tells the deliveries.
// Integers are little-endian; what has a variable size stands behind it.

using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Security.Cryptography;
using System.Text;
using UdpBridge;

internal static class Exchange
{
    private static readonly BinaryReader Asked = new BinaryReader(Console.OpenStandardInput());
    private static readonly StringBuilder Told = new StringBuilder();
    private const long WallNanos = 1800000000 * Wire.Nanos;  // ahead of the time of arrivals

    private static void Main(string[] words)
    {
        Stream output = Console.OpenStandardOutput();
        for (int kind; (kind = Asked.BaseStream.ReadByte()) >= 0;)
        {
            if (kind == 'R') Receive(uint.Parse(words[0]));
            else if (kind == 'T') ReadTyped();
            else if (kind == 'C') ReadCdr();
            else if (kind == 'Q') Queue();
            else Send();
            byte[] bytes = Encoding.ASCII.GetBytes(Told.ToString());
            Told.Clear();
            output.Write(bytes, 0, bytes.Length);
            output.Flush();
        }
    }

    private static void Receive(uint receiveBuffer)
    {
        var receiver = new Receiver(new Limits { ReceiveBuffer = receiveBuffer });
        receiver.AnswerChallengesOf((byte)1);
        Counters counts = receiver.Counters;
        var buffer = new byte[Wire.LargestDatagram];
        for (uint left = Asked.ReadUInt32(); left > 0; --left)
        {
            long nowNanos = Asked.ReadInt64();
            byte sender = Asked.ReadByte();
            byte[] datagram = Bytes();
            if (sender == 255)
            {
                receiver.Report(nowNanos, WallNanos + nowNanos,
                                (to, report) => Line("report", to, Hex(report)));
                continue;
            }
            datagram.CopyTo(buffer, 0);
            byte[] credit;
            Message m = receiver.Receive(buffer, datagram.Length, sender, nowNanos, out credit);
            if (credit != null) Line("credit", Hex(credit));
            if (m == null) continue;
            Header h = m.Header;
            byte[] digest = new SHA256Managed().ComputeHash(m.Body);
            Line("message", (int)h.Type, h.SeqNumber, h.StampNanos, h.PartsMax, Hex(Utf8(h.Topic)),
                 Hex(Utf8(h.Link)), m.Body.Length, Hex(digest));
        }
        receiver.GiveUpAll();
        foreach (var refused in counts.Refused) Line("refused", refused.Key, refused.Value);
        Line("end", counts.Messages, counts.Incomplete, counts.Late, counts.Missing,
             counts.Duplicates, receiver.MemoryBytes);
    }

    // What is packed again differs from the body: that is what is told then.
    private static void ReadTyped()
    {
        byte[] body = Bytes();
        Typed typed;
        string reason = Typed.Parse(body, out typed);
        if (reason != null)
        {
            Line("end", reason);
            return;
        }
        var cdr = new byte[body.Length - typed.Offset];
        Array.Copy(body, typed.Offset, cdr, 0, cdr.Length);
        byte[] again = Typed.Pack(typed.RosType, cdr, cdr.Length);
        if (Hex(again) == Hex(body)) Line("end", typed.RosType, typed.Offset);
        else Line("end", Hex(again));
    }

    private static void ReadCdr()
    {
        IRosMessage message = Body.Of((MessageType)Asked.ReadByte());
        byte[] body = Bytes();
        try
        {
            Cdr.Decode(body, message);
            Body.Tell(message, "", Line);
            Line("end", Hex(Cdr.Encode(message)));
        }
        catch (CdrException)
        {
            Told.Clear();
            Line("end", "refused");
        }
    }

    private static void Queue()
    {
        var queue = new SendQueue(Asked.ReadInt32());
        var receiver = new Receiver();
        long nowNanos = 0;
        receiver.OnControl = (from, header, body) => queue.Receive(header, body, nowNanos);
        var datagram = new byte[Wire.LargestDatagram];
        for (uint left = Asked.ReadUInt32(); left > 0; --left)
        {
            char operation = (char)Asked.ReadByte();
            nowNanos = Asked.ReadInt64();
            if (operation == 'p')
            {
                var type = (MessageType)Asked.ReadByte();
                long stampNanos = Asked.ReadInt64();
                string topic = Encoding.UTF8.GetString(Bytes()), link = Encoding.UTF8.GetString(Bytes());
                queue.Put(type, topic, link, stampNanos, Bytes());
            }
            else if (operation == 'n')
            {
                for (int size; (size = queue.Next(datagram, nowNanos)) > 0;)
                {
                    byte[] digest = new SHA256Managed().ComputeHash(datagram, 0, size);
                    Line("datagram", size, Hex(digest));
                }
                Line("wake", queue.NextWake(nowNanos), queue.IsIdle, queue.Stalls);
            }
            else if (operation == 'c')
            {
                byte[] credit, control = Bytes();
                receiver.Receive(control, control.Length, "peer", nowNanos, out credit);
            }
            else
            {
                List<DeliveryCounts> deliveries = queue.Deliveries(nowNanos);
                foreach (DeliveryCounts one in deliveries.OrderBy(one => one.Type)
                         .ThenBy(one => one.Topic, StringComparer.Ordinal)) Tell(one);
                LinkReport peer = queue.PeerReport;
                if (peer == null) continue;
                Line("peer", peer.ReceiveBuffer, peer.Datagrams, peer.Bytes, peer.Refused,
                     peer.KernelDrops, string.Join(" ", peer.Reasons));
            }
        }
        Line("end");
    }

    private static void Tell(DeliveryCounts one)
    {
        Line("deliveries", (int)one.Type, one.Topic, one.Sent, one.SentBytes, one.Superseded,
             one.Delivered, one.Dropped, one.Incomplete, one.Late, one.Missing, one.InFlight,
             one.DeliveredBytes);
    }

    private static void Send()
    {
        var type = (MessageType)Asked.ReadByte();
        long stampNanos = Asked.ReadInt64();
        uint times = Asked.ReadUInt32();
        int largest = Asked.ReadInt32();
        string topic = Encoding.UTF8.GetString(Bytes()), link = Encoding.UTF8.GetString(Bytes());
        byte[] body = Bytes();
        var sender = new Sender();
        bool isSent = true;
        for (; times > 0; --times)
        {
            Action<byte[], int> emit = (datagram, size) =>
            {
                if (times > 1) return;
                Array.Resize(ref datagram, size);
                Line("datagram", Hex(datagram));
            };
            isSent = sender.Send(type, topic, link, stampNanos, body, body.Length, largest, emit);
        }
        Line("end", isSent ? 1 : 0);
    }

    private static byte[] Bytes()
    {
        return Asked.ReadBytes(Asked.ReadInt32());
    }

    private static byte[] Utf8(string text)
    {
        return Encoding.UTF8.GetBytes(text);
    }

    private static string Hex(byte[] bytes)
    {
        return "x" + BitConverter.ToString(bytes).Replace("-", "");
    }

    private static void Line(params object[] words)
    {
        Told.Append(string.Join(" ", words)).Append('\n');
    }
}
