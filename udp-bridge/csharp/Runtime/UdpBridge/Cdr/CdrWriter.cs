// SPDX-License-Identifier: Apache-2.0

using System;
using System.Text;

namespace UdpBridge
{
    /// <summary>Writes the fields of a message as CDR: XCDR1, little-endian, each field aligned to
    /// its size behind the 4 bytes of the encapsulation header, padding zero.</summary>
    public sealed class CdrWriter
    {
        private const int Encapsulation = 4;

        private byte[] buffer = new byte[256];
        private int at;

        /// <summary>Begin a body.</summary>
        public CdrWriter()
        {
            buffer[1] = 1;
            at = Encapsulation;
        }

        /// <summary>Return the body as written so far.</summary>
        public byte[] ToArray()
        {
            var body = new byte[at];
            Buffer.BlockCopy(buffer, 0, body, 0, at);
            return body;
        }

        /// <summary>Write a uint8.</summary>
        public void Write(byte value)
        {
            int place = Take(1, 1);  // may replace the buffer
            buffer[place] = value;
        }

        /// <summary>Write an int8.</summary>
        public void Write(sbyte value)
        {
            Write(unchecked((byte)value));
        }

        /// <summary>Write a bool.</summary>
        public void Write(bool value)
        {
            Write((byte)(value ? 1 : 0));
        }

        /// <summary>Write a uint16.</summary>
        public void Write(ushort value)
        {
            int place = Take(2, 2);
            buffer[place] = unchecked((byte)value);
            buffer[place + 1] = (byte)(value >> 8);
        }

        /// <summary>Write an int32.</summary>
        public void Write(int value)
        {
            Write(unchecked((uint)value));
        }

        /// <summary>Write a uint32.</summary>
        public void Write(uint value)
        {
            int place = Take(4, 4);
            Wire.WriteU32(buffer, place, value);
        }

        /// <summary>Write an int64.</summary>
        public void Write(long value)
        {
            int place = Take(8, 8);
            Wire.WriteU64(buffer, place, unchecked((ulong)value));
        }

        /// <summary>Write a float32.</summary>
        public void Write(float value)
        {
            Write(Float32.ToBits(value));
        }

        /// <summary>Write a float64.</summary>
        public void Write(double value)
        {
            Write(BitConverter.DoubleToInt64Bits(value));
        }

        /// <summary>Write a string. Throws <see cref="CdrException"/> where it has a lone surrogate
        /// or NUL, which no ROS string has.</summary>
        public void Write(string text)
        {
            if (text.IndexOf('\0') >= 0) throw new CdrException("a string holds NUL");
            try
            {
                int size = Wire.Utf8.GetByteCount(text);
                Write((uint)size + 1);
                int place = Take(1, size + 1);
                Wire.Utf8.GetBytes(text, 0, text.Length, buffer, place);
            }
            catch (EncoderFallbackException)
            {
                throw new CdrException("a string has a lone surrogate");
            }
        }

        /// <summary>Write a uint8[].</summary>
        public void Write(byte[] all)
        {
            WriteBlock(all, all.Length);
        }

        /// <summary>Write an int8[].</summary>
        public void Write(sbyte[] all)
        {
            WriteBlock(all, all.Length);
        }

        /// <summary>Write an int64[].</summary>
        public void Write(long[] all)
        {
            Write((uint)all.Length);
            foreach (long one in all) Write(one);
        }

        /// <summary>Write a string[].</summary>
        public void Write(string[] all)
        {
            Write((uint)all.Length);
            foreach (string one in all) Write(one);
        }

        /// <summary>Write an array of fixed length, such as float64[9].</summary>
        public void WriteFixed(double[] all)
        {
            foreach (double one in all) Write(one);
        }

        private void WriteBlock(Array all, int size)
        {
            Write((uint)size);
            int place = Take(1, size);
            Buffer.BlockCopy(all, 0, buffer, place, size);
        }

        // Return where an aligned field of so many bytes goes; the bytes there are zero.
        private int Take(int alignment, int size)
        {
            int place = Encapsulation + (at - Encapsulation + alignment - 1) / alignment * alignment;
            at = place + size;
            if (at > buffer.Length) Array.Resize(ref buffer, Math.Max(at, buffer.Length * 2));
            return place;
        }
    }
}
