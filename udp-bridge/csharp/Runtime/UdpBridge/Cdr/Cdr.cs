// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    /// <summary>Converts between messages and bodies.</summary>
    public static class Cdr
    {
        /// <summary>Return the body of a message. Throws <see cref="CdrException"/> where a string
        /// can't be written.</summary>
        public static byte[] Encode(IRosMessage message)
        {
            var writer = new CdrWriter();
            message.Write(writer);
            return writer.ToArray();
        }

        /// <summary>Return the message that a body holds. Throws <see cref="CdrException"/> where it
        /// is none of this type: it ends too early, or other bytes follow.</summary>
        public static T Decode<T>(byte[] body) where T : IRosMessage, new()
        {
            var message = new T();
            Decode(body, message);
            return message;
        }

        /// <summary>Read a body into an existing message; see the other method.</summary>
        public static void Decode(byte[] body, IRosMessage into)
        {
            var reader = new CdrReader(body);
            into.Read(reader);
            reader.End();
        }
    }
}
