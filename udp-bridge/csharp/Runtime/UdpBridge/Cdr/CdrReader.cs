// SPDX-License-Identifier: Apache-2.0

using System;
using System.Text;

namespace UdpBridge
{
    /// <summary>Reads the fields of a message from CDR: XCDR1, little-endian, each field aligned to
    /// its size behind the 4 bytes of the encapsulation header. Every method throws
    /// <see cref="CdrException"/> where the bytes end before the field does.</summary>
    public sealed class CdrReader
    {
        private const int Encapsulation = 4;
        private const int MostPadding = 3;  // DDS fills a body up to a multiple of 4

        private readonly byte[] body;
        private int at = Encapsulation;

        /// <summary>Begin behind the encapsulation header of a body.</summary>
        public CdrReader(byte[] body)
        {
            bool isCdr = body.Length >= Encapsulation && body[0] == 0 && body[1] == 1;
            if (!isCdr) throw new CdrException("does not begin with 00 01, little-endian CDR");
            this.body = body;
        }

        /// <summary>Read a uint8.</summary>
        public byte ReadByte()
        {
            return body[Take(1, 1)];
        }

        /// <summary>Read an int8.</summary>
        public sbyte ReadSByte()
        {
            return unchecked((sbyte)ReadByte());
        }

        /// <summary>Read a bool, a byte that is 0 or not.</summary>
        public bool ReadBoolean()
        {
            return ReadByte() != 0;
        }

        /// <summary>Read a uint16.</summary>
        public ushort ReadUInt16()
        {
            int place = Take(2, 2);
            return (ushort)(body[place] | body[place + 1] << 8);
        }

        /// <summary>Read an int32.</summary>
        public int ReadInt32()
        {
            return unchecked((int)ReadUInt32());
        }

        /// <summary>Read a uint32.</summary>
        public uint ReadUInt32()
        {
            return Wire.ReadU32(body, Take(4, 4));
        }

        /// <summary>Read an int64.</summary>
        public long ReadInt64()
        {
            return unchecked((long)Wire.ReadU64(body, Take(8, 8)));
        }

        /// <summary>Read a float32.</summary>
        public float ReadSingle()
        {
            return Float32.FromBits(ReadUInt32());
        }

        /// <summary>Read a float64.</summary>
        public double ReadDouble()
        {
            return BitConverter.Int64BitsToDouble(ReadInt64());
        }

        /// <summary>Read a string.</summary>
        public string ReadString()
        {
            int size = ReadCount(1);
            if (size == 0) return "";  // some writers leave out the NUL of an empty string
            int place = Take(1, size);
            if (body[place + size - 1] != 0) throw new CdrException("a string does not end with NUL");
            try
            {
                return Wire.Utf8.GetString(body, place, size - 1);
            }
            catch (DecoderFallbackException)
            {
                throw new CdrException("a string is not UTF-8");
            }
        }

        /// <summary>Read the number of elements of a sequence, of which each takes at least so many
        /// bytes. A sequence that the body can't hold is refused before memory is taken.</summary>
        public int ReadCount(int leastBytes)
        {
            uint count = ReadUInt32();
            if (count > (body.Length - at) / leastBytes) throw Short(count + " elements");
            return (int)count;
        }

        /// <summary>Read a uint8[].</summary>
        public byte[] ReadBytes()
        {
            var all = new byte[ReadCount(1)];
            Buffer.BlockCopy(body, Take(1, all.Length), all, 0, all.Length);
            return all;
        }

        /// <summary>Read an int8[].</summary>
        public sbyte[] ReadSBytes()
        {
            var all = new sbyte[ReadCount(1)];
            Buffer.BlockCopy(body, Take(1, all.Length), all, 0, all.Length);
            return all;
        }

        /// <summary>Read an int64[].</summary>
        public long[] ReadInt64s()
        {
            var all = new long[ReadCount(8)];
            for (int i = 0; i < all.Length; ++i) all[i] = ReadInt64();
            return all;
        }

        /// <summary>Read a string[].</summary>
        public string[] ReadStrings()
        {
            var all = new string[ReadCount(4)];
            for (int i = 0; i < all.Length; ++i) all[i] = ReadString();
            return all;
        }

        /// <summary>Read an array of fixed length, such as float64[9], into an existing one.</summary>
        public void ReadDoubles(double[] all)
        {
            for (int i = 0; i < all.Length; ++i) all[i] = ReadDouble();
        }

        /// <summary>Check that the message ends where the body ends, but for up to 3 bytes of
        /// padding.</summary>
        public void End()
        {
            int left = body.Length - at;
            if (left > MostPadding) throw new CdrException(left + " bytes follow the message");
        }

        // Return where an aligned field of so many bytes is, and go behind it.
        private int Take(int alignment, int size)
        {
            int place = Encapsulation + (at - Encapsulation + alignment - 1) / alignment * alignment;
            if (place > body.Length || size > body.Length - place) throw Short(size + " bytes");
            at = place + size;
            return place;
        }

        private CdrException Short(string wanted)
        {
            return new CdrException("ends at byte " + body.Length + "; expected " + wanted
                                    + " from byte " + at + " on");
        }
    }
}
