// SPDX-License-Identifier: Apache-2.0
// The messages of the library by type, and their fields as text.

using System;
using System.Collections;
using System.Globalization;
using System.Reflection;
using System.Text;
using UdpBridge;
using UdpBridge.Messages;

internal static class Body
{
    internal static IRosMessage Of(MessageType type)
    {
        string name = "UdpBridge.Messages." + type;
        return (IRosMessage)Activator.CreateInstance(typeof(Twist).Assembly.GetType(name));
    }

    // A line for each field: its path and its value; of text and bytes the hexadecimal digits.
    internal static void Tell(object value, string path, Action<object[]> line)
    {
        var text = value as string;
        var bytes = value as byte[];
        if (text != null) bytes = Encoding.UTF8.GetBytes(text);
        if (bytes != null)
        {
            line(new object[] { "field", path, "x" + BitConverter.ToString(bytes).Replace("-", "") });
        }
        else if (value is IEnumerable)
        {
            int index = 0;
            foreach (object one in (IEnumerable)value) Tell(one, path + "." + index++, line);
            line(new object[] { "field", path + ".count", index });
        }
        else if (value.GetType().IsPrimitive)
        {
            line(new object[] { "field", path, Number(value) });
        }
        else
        {
            PropertyInfo header = value.GetType().GetProperty("Header");
            if (header != null) Tell(header.GetValue(value), path + ".Header", line);
            foreach (FieldInfo field in value.GetType().GetFields())
            {
                if (!field.IsLiteral) Tell(field.GetValue(value), path + "." + field.Name, line);
            }
        }
    }

    private static string Number(object value)
    {
        if (value is bool) return (bool)value ? "1" : "0";
        string format = value is double ? "G17" : value is float ? "G9" : "D";
        return ((IFormattable)value).ToString(format, CultureInfo.InvariantCulture);
    }
}
