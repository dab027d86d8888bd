// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    // The bodies of Control, PROTOCOL.md, section 6.
    internal static class ControlBody
    {
        internal const byte Credit = 0, TopicReport = 1, LinkReport = 2, CreditRequest = 3;
        internal const byte AddressChallenge = 8, AddressResponse = 9;
        internal const int CreditSize = 12;

        private const int LinkReportSize = 40, ReasonSize = 9, MostReasons = 32, LongestName = 32;
        private const int Numbers = 16, Counts = 24, CountsEnd = 64;  // places of uint64s

        // Return null, or why a body is refused.
        internal static string Check(byte[] data, int at, int size)
        {
            if (size == 0) return "body_size";
            switch (data[at])
            {
                case Credit: return CheckTyped(data, at, size == CreditSize);
                case TopicReport: return CheckReport(data, at, size);
                case LinkReport: return CheckLinkReport(data, at, size);
                case CreditRequest: return size == 4 ? null : "body_size";
                case AddressChallenge:
                case AddressResponse: return size == 16 ? null : "body_size";
                default: return "body_value";
            }
        }

        private static string CheckTyped(byte[] data, int at, bool isSize)
        {
            if (!isSize) return "body_size";
            return Wire.IsInTable(data[at + 1]) ? null : "body_value";
        }

        // The five counts are at most as many as the numbers; their sum could overflow.
        private static string CheckReport(byte[] data, int at, int size)
        {
            if (size != UdpBridge.TopicReport.Size) return "body_size";
            ulong left = Wire.ReadU64(data, at + Numbers);
            for (int place = Counts; place < CountsEnd; place += 8)
            {
                ulong count = Wire.ReadU64(data, at + place);
                if (count > left) return "body_value";
                left -= count;
            }
            return CheckTyped(data, at, true);
        }

        private static string CheckLinkReport(byte[] data, int at, int size)
        {
            if (size < LinkReportSize) return "body_size";
            int end = at + size;
            at += LinkReportSize;
            for (int i = 0; i < MostReasons && at < end; ++i)
            {
                if (end - at < ReasonSize) return "body_size";
                int name = data[at + ReasonSize - 1];
                at += ReasonSize;
                if (end - at < name) return "body_size";
                if (name == 0 || name > LongestName) return "body_value";
                for (; name > 0; --name, ++at)
                {
                    byte c = data[at];
                    bool isLetter = c >= 'a' && c <= 'z', isDigit = c >= '0' && c <= '9';
                    if (!isLetter && !isDigit && c != '_') return "body_value";
                }
            }
            return at == end ? null : "body_size";
        }
    }
}
