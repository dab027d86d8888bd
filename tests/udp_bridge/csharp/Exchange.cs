// SPDX-License-Identifier: Apache-2.0
// Does on stdin and stdout what the tests ask for, as often as they ask.
//
// 'R' COUNT (NOW_NANOS SENDER SIZE DATAGRAM)...: a new Receiver takes them; a line for each message,
// Credit, report and refusal, and one of counts; SENDER 255 stands for a time to report. 'S' TYPE STAMP TIMES LARGEST TOPIC LINK BODY: a new Sender
// sends that so many times; a line for each datagram of the last time, and whether it was sent.
// 'T' BODY: the ROS type and the offset of a Typed body, or why it is refused.
// Integers are little-endian; what has a variable size stands behind it.

using System;
using System.IO;
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
