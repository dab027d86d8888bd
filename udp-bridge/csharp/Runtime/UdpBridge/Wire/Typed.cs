// SPDX-License-Identifier: Apache-2.0

using System;
using System.Text;

namespace UdpBridge
{
    /// <summary>Type 67: a message of the ROS type that the body names, PROTOCOL.md, section 4.1.</summary>
    public struct Typed
    {
        private const string Middle = "/msg/";

        /// <summary>Full ROS 2 type name, such as sensor_msgs/msg/MagneticField.</summary>
        public string RosType { get; set; }

        /// <summary>Where the CDR begins in the body, a multiple of 8.</summary>
        public int Offset { get; set; }

        /// <summary>Return the body of a message; null where the type is not package/msg/Name.</summary>
        /// <param name="rosType">Full ROS 2 type name.</param>
        /// <param name="cdr">The complete message in CDR, at the beginning of this buffer.</param>
        /// <param name="size">Its bytes.</param>
        public static byte[] Pack(string rosType, byte[] cdr, int size)
        {
            if (!IsName(rosType)) return null;
            int offset = (rosType.Length + 8) / 8 * 8;
            var body = new byte[offset + size];
            body[0] = (byte)rosType.Length;
            Encoding.ASCII.GetBytes(rosType, 0, rosType.Length, body, 1);
            Array.Copy(cdr, 0, body, offset, size);
            return body;
        }

        /// <summary>Read the beginning of a body.</summary>
        /// <returns>Null, or why a receiver drops the message: type_name.</returns>
        public static string Parse(byte[] body, out Typed to)
        {
            to = new Typed();
            if (body.Length == 0) return "type_name";
            to.Offset = (body[0] + 8) / 8 * 8;
            if (to.Offset > body.Length) return "type_name";
            var name = new char[body[0]];
            for (int i = 0; i < name.Length; ++i) name[i] = (char)body[1 + i];
            to.RosType = new string(name);
            return IsName(to.RosType) ? null : "type_name";
        }

        // Whether a text matches [a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]* and has at most 255 bytes.
        private static bool IsName(string text)
        {
            int slash = text.IndexOf('/'), name = slash + Middle.Length;
            if (text.Length > 255 || slash < 1 || name >= text.Length) return false;
            if (string.CompareOrdinal(text, slash, Middle, 0, Middle.Length) != 0) return false;
            if (!IsLower(text[0]) || !IsUpper(text[name])) return false;
            for (int i = 0; i < slash; ++i)
            {
                if (!IsLower(text[i]) && !IsDigit(text[i]) && text[i] != '_') return false;
            }
            for (int i = name; i < text.Length; ++i)
            {
                if (!IsLower(text[i]) && !IsUpper(text[i]) && !IsDigit(text[i])) return false;
            }
            return true;
        }

        private static bool IsLower(char c)
        {
            return c >= 'a' && c <= 'z';
        }

        private static bool IsUpper(char c)
        {
            return c >= 'A' && c <= 'Z';
        }

        private static bool IsDigit(char c)
        {
            return c >= '0' && c <= '9';
        }
    }
}
