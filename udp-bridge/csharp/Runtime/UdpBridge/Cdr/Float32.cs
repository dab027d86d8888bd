// SPDX-License-Identifier: Apache-2.0

using System.Runtime.InteropServices;

namespace UdpBridge
{
    /// <summary>The bits of a float32, without unsafe code and without memory for each.</summary>
    [StructLayout(LayoutKind.Explicit)]
    internal struct Float32
    {
        [FieldOffset(0)] private float value;
        [FieldOffset(0)] private uint bits;

        internal static uint ToBits(float value)
        {
            return new Float32 { value = value }.bits;
        }

        internal static float FromBits(uint bits)
        {
            return new Float32 { bits = bits }.value;
        }
    }
}
