// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    /// <summary>The bytes are not a message of the type that was read.</summary>
    public sealed class CdrException : FormatException
    {
        /// <summary>Create it with the reason.</summary>
        public CdrException(string reason) : base(reason)
        {
        }
    }
}
