-- SPDX-License-Identifier: Apache-2.0
-- Wireshark dissector of the UDP Bridge protocol, for Wireshark and tshark 3.6 and later.
--
-- Try it:    tshark -X lua_script:udp_bridge.lua -r capture.pcapng -V
-- Install:   copy it into the folder that Wireshark names under
--            Help > About > Folders > Personal Lua Plugins.
--
-- A datagram that PROTOCOL.md refuses is shown as an error under the same name
-- (`udpbridge.refused`); the tests are made in the same order. Only rules about a single datagram
-- are checked: duplicates, order and part sizes need other datagrams. Bodies of ROS types are
-- shown as bytes, because Wireshark has no CDR reader.

-- Name, ROS type and default topic, by msg_type. Generated: `python -m tools.wire_types`.
local TYPES = {
    [1] = {"PointCloud2", "sensor_msgs/msg/PointCloud2", "/points"},
    [2] = {"Imu", "sensor_msgs/msg/Imu", "/imu"},
    [3] = {"CompressedImage", "sensor_msgs/msg/CompressedImage", "/image/compressed"},
    [4] = {"NavSatFix", "sensor_msgs/msg/NavSatFix", "/fix"},
    [5] = {"WheelEncoders", "groundlink_msgs/msg/WheelEncoders", "/wheels"},
    [6] = {"Range", "sensor_msgs/msg/Range", "/range"},
    [7] = {"Subscribe", "", ""},
    [8] = {"Clock", "rosgraph_msgs/msg/Clock", "/clock"},
    [9] = {"Twist", "geometry_msgs/msg/Twist", "/cmd_vel"},
    [10] = {"PoseStamped", "geometry_msgs/msg/PoseStamped", "/pose"},
    [11] = {"OccupancyGrid", "nav_msgs/msg/OccupancyGrid", "/map"},
    [32] = {"LaserScan", "sensor_msgs/msg/LaserScan", "/scan"},
    [33] = {"Image", "sensor_msgs/msg/Image", "/image"},
    [34] = {"CameraInfo", "sensor_msgs/msg/CameraInfo", "/camera_info"},
    [35] = {"TFMessage", "tf2_msgs/msg/TFMessage", "/tf"},
    [36] = {"Odometry", "nav_msgs/msg/Odometry", "/odom"},
    [37] = {"JointState", "sensor_msgs/msg/JointState", "/joint_states"},
    [38] = {"TwistStamped", "geometry_msgs/msg/TwistStamped", "/cmd_vel"},
    [39] = {"String", "std_msgs/msg/String", "/robot_description"},
    [40] = {"Path", "nav_msgs/msg/Path", "/plan"},
    [64] = {"Control", "", ""},
    [65] = {"Resend", "", ""},
    [66] = {"Repair", "", ""},
    [67] = {"Typed", "*", ""},
}

local SUBSCRIBE, CONTROL, RESEND, REPAIR, TYPED, SEALED = 7, 64, 65, 66, 67, 68
local SEALED_HEAD, TAG_SIZE, RAPTORQ, WHOLE_MAX, REASONS_MAX = 28, 16, 1, 64, 32
local FIXED_SIZE, SMALLEST_HEADER, NANOS = 18, 20, 1000000000

local TYPE_NAMES = {[SEALED] = "Sealed"}
for number, row in pairs(TYPES) do TYPE_NAMES[number] = row[1] end

local proto = Proto("udpbridge", "UDP Bridge")
local fields = {}

local function field(name, make, label, ...)
    fields[name] = make("udpbridge." .. name, label, ...)
end

field("msg_type", ProtoField.uint8, "Type", base.DEC, TYPE_NAMES)
field("header_size", ProtoField.uint8, "Header size")
field("seq_number", ProtoField.uint32, "Sequence number")
field("part_number", ProtoField.uint8, "Part")
field("parts_max", ProtoField.uint8, "Parts of the message")
field("time_sec", ProtoField.int32, "Stamp, seconds")
field("time_nsec", ProtoField.int32, "Stamp, nanoseconds")
field("stamp", ProtoField.absolute_time, "Stamp", base.UTC)
field("topic_size", ProtoField.uint8, "Topic size")
field("link_size", ProtoField.uint8, "Link size")
field("topic", ProtoField.string, "Topic", base.UNICODE)
field("link", ProtoField.string, "Link", base.UNICODE)
field("padding", ProtoField.bytes, "Padding")
field("ros_type", ProtoField.string, "ROS type")
field("default_topic", ProtoField.string, "Default topic of the type")
field("fragment", ProtoField.bytes, "Fragment of the body")
field("fragment_size", ProtoField.uint32, "Fragment size")
field("first_part", ProtoField.framenum, "First captured part of the message", base.NONE)
field("refused", ProtoField.string, "Refused because")

-- A body's layout: offset, size, name, ProtoField, label, and what else the field takes.
local function layout(prefix, rows)
    for _, row in ipairs(rows) do
        row.name = prefix .. "." .. row[3]
        fields[row.name] = row[4]("udpbridge." .. row.name, row[5], row[6], row[7])
    end
    return rows
end

local u8, u16, u32, u64 = ProtoField.uint8, ProtoField.uint16, ProtoField.uint32, ProtoField.uint64
local ACTIONS = {[0] = "unsubscribe", [1] = "subscribe"}
local stamp64 = ProtoField.int64
local SUBSCRIBE_BODY = layout("subscribe", {
    size = 8,
    {0, 1, "wanted_type", u8, "Requested type", base.DEC, TYPE_NAMES},
    {1, 1, "action", u8, "Action", base.DEC, ACTIONS},
    {2, 2, "lease", u16, "Lease in s (0: until unsubscribed)"},
    {4, 4, "max_rate", ProtoField.float, "Highest rate in Hz (0: all)"},
})
local CREDIT = layout("credit", {
    size = 12,
    {1, 1, "msg_type", u8, "Acknowledged type", base.DEC, TYPE_NAMES},
    {2, 1, "part_number", u8, "Acknowledged part"},
    {4, 4, "seq_number", u32, "Acknowledged sequence number"},
    {8, 4, "receive_buffer", u32, "Receive buffer in bytes"},
})
local CREDIT_REQUEST = layout("credit_request", {size = 4})
local TOPIC_REPORT = layout("topic_report", {
    size = 128,
    {1, 1, "msg_type", u8, "Reported type", base.DEC, TYPE_NAMES},
    {4, 4, "first_number", u32, "First sequence number"},
    {8, 8, "since", stamp64, "Counted since, in ns"},
    {16, 8, "numbers", u64, "Messages from the first to the newest"},
    {24, 8, "published", u64, "Messages published"},
    {32, 8, "dropped", u64, "Messages dropped at the receiver"},
    {40, 8, "incomplete", u64, "Messages given up"},
    {48, 8, "late", u64, "Messages late"},
    {56, 8, "pending", u64, "Messages pending"},
    {64, 8, "repaired", u64, "Messages repaired"},
    {72, 8, "duplicates", u64, "Duplicate datagrams"},
    {80, 8, "body_bytes", u64, "Bytes of the messages published"},
    {88, 8, "first_seen_stamp", stamp64, "Stamp of the first number in ns"},
    {96, 8, "first_stamp", stamp64, "Stamp of the first message published in ns"},
    {104, 8, "last_stamp", stamp64, "Stamp of the last message published in ns"},
    {112, 8, "age_p50", stamp64, "Median age in ns"},
    {120, 8, "age_p99", stamp64, "Age that 99 % do not exceed in ns"},
})
local LINK_REPORT = layout("link_report", {
    size = 40,
    {4, 4, "receive_buffer", u32, "Receive buffer in bytes"},
    {8, 8, "datagrams", u64, "Datagrams received"},
    {16, 8, "bytes", u64, "Bytes received"},
    {24, 8, "refused", u64, "Datagrams refused"},
    {32, 8, "kernel_drops", u64, "Datagrams dropped by the kernel"},
})
local BARRIER = layout("barrier", {
    size = 24,
    {1, 1, "topics", u8, "Topics with messages"},
    {2, 1, "responses", u8, "Expected responses"},
    {3, 1, "in_turn", u8, "One message at a time"},
    {4, 4, "limit", u32, "Time to wait for missing messages, in ms"},
    {8, 8, "episode", u64, "Episode of the run"},
    {16, 8, "tick", stamp64, "Tick (-1: before the first)"},
})
local BARRIER_REPLY = layout("barrier_reply", {
    size = 24,
    {1, 1, "topics", u8, "Topics with messages"},
    {2, 1, "state", u8, "State", base.DEC,
        {[0] = "done", [1] = "waiting", [2] = "incomplete", [3] = "restarted"}},
    {4, 4, "lost", u32, "Messages lost"},
    {8, 8, "episode", u64, "Episode of the run"},
    {16, 8, "tick", stamp64, "Tick (-1: before the first)"},
})
local RUN_COMMAND = layout("run_command", {
    size = 16,
    {1, 1, "action", u8, "Action", base.DEC,
        {[0] = "query", [1] = "pause", [2] = "resume", [3] = "step", [4] = "reset"}},
    {4, 4, "ticks", u32, "Ticks to step"},
    {8, 8, "number", u64, "Number of the command"},
})
local RUN_COMMAND_REPLY = layout("run_command_reply", {
    size = 24, text_max = 1024,
    {1, 1, "state", u8, "State of the run", base.DEC,
        {[0] = "stopped", [1] = "running", [2] = "paused"}},
    {8, 8, "number", u64, "Number of the command"},
    {16, 8, "tick", stamp64, "Tick"},
})
local ADDRESS_CHALLENGE = layout("address_challenge", {
    size = 16,
    {4, 12, "cookie", ProtoField.bytes, "Cookie"},
})
local ADDRESS_RESPONSE = layout("address_response", {
    size = 16,
    {4, 12, "cookie", ProtoField.bytes, "Cookie"},
})
local WORLD_QUERY = layout("world_query", {
    size = 16,
    {8, 8, "number", u64, "Number of the query"},
})
local WORLD_REPLY = layout("world_reply", {
    size = 16,
    {8, 8, "number", u64, "Number of the query"},
})
local SENT = layout("sent", {
    size = 8,
    {0, 1, "msg_type", u8, "Type", base.DEC, TYPE_NAMES},
    {2, 2, "messages", u16, "Messages"},
    {4, 4, "first", u32, "Sequence number of the first"},
})
local OFFER = layout("offer", {
    size = 8,
    {1, 1, "msg_type", u8, "Offered type", base.DEC, TYPE_NAMES},
    {2, 1, "parts_max", u8, "Parts of the message"},
    {4, 4, "limit", u32, "May be requested for, in ms"},
})
local REQUEST = layout("request", {
    size = 8,
    {1, 1, "msg_type", u8, "Requested type", base.DEC, TYPE_NAMES},
    {2, 1, "parts_max", u8, "Parts of the message (0: whole messages)"},
    {3, 1, "messages", u8, "Messages"},
    {4, 4, "goodput", u32, "Bytes received within the last second"},
})
local SYMBOL = layout("symbol", {
    size = 8,
    {0, 1, "msg_type", u8, "Repaired type", base.DEC, TYPE_NAMES},
    {1, 1, "parts_max", u8, "Parts of the message"},
    {2, 1, "code", u8, "Code", base.DEC, {[RAPTORQ] = "RaptorQ"}},
    {4, 4, "body_size", u32, "Bytes of the whole body"},
})
local SEAL = layout("sealed", {
    {2, 4, "sender", u32, "Sender"},
    {8, 4, "direction", ProtoField.int32, "Direction", base.DEC, {[0] = "to ROS", [1] = "from ROS"}},
    {20, 8, "counter", u64, "Counter"},
})
field("control.kind", u8, "Kind of Control", base.DEC,
    {[0] = "Credit", [1] = "TopicReport", [2] = "LinkReport", [3] = "CreditRequest",
     [4] = "Barrier", [5] = "BarrierReply", [6] = "RunCommand", [7] = "RunCommandReply",
     [8] = "AddressChallenge", [9] = "AddressResponse", [10] = "WorldQuery", [11] = "WorldReply"})
field("sent.topic", ProtoField.string, "Topic", base.UNICODE)
field("response.msg_type", u8, "Type of the responses (0: any)", base.DEC, TYPE_NAMES)
field("response.topic", ProtoField.string, "Responses on", base.UNICODE)
field("response.of", ProtoField.string, "each message on", base.UNICODE)
field("response.every", u8, "of every n-th message (255: of each stamp)")
field("run_command_reply.error", ProtoField.string, "Error", base.UNICODE)
field("world_text.packed", ProtoField.bytes, "Compressed text")
field("world_text.text", ProtoField.string, "Text", base.UNICODE)
field("resend.kind", u8, "Kind of Resend", base.DEC, {[0] = "Offer", [1] = "Request"})
field("link_report.reason", ProtoField.string, "Reason")
field("link_report.reason_count", u64, "Datagrams refused for it")
field("request.parts", ProtoField.string, "Requested parts")
field("symbol.data", ProtoField.bytes, "Symbol")
field("typed.name_size", u8, "Bytes of the ROS type's name")
field("typed.ros_type", ProtoField.string, "ROS type of the body")
field("sealed.tag", ProtoField.bytes, "Tag")

local all_fields = {}
for _, each in pairs(fields) do table.insert(all_fields, each) end
proto.fields = all_fields
local refused_expert = ProtoExpert.new(
    "udpbridge.refused.expert", "A receiver refuses this datagram",
    expert.group.MALFORMED, expert.severity.ERROR)
proto.experts = {refused_expert}

-- What may follow a byte of UTF-8: length of the sequence and range of its second byte, as in
-- table 3-7 of the Unicode standard. Everything else is no UTF-8.
local SEQUENCES = {
    {0x00, 0x7F, 1}, {0xC2, 0xDF, 2, 0x80, 0xBF}, {0xE0, 0xE0, 3, 0xA0, 0xBF},
    {0xE1, 0xEC, 3, 0x80, 0xBF}, {0xED, 0xED, 3, 0x80, 0x9F}, {0xEE, 0xEF, 3, 0x80, 0xBF},
    {0xF0, 0xF0, 4, 0x90, 0xBF}, {0xF1, 0xF3, 4, 0x80, 0xBF}, {0xF4, 0xF4, 4, 0x80, 0x8F},
}

local function is_utf8(text)
    local at = 1
    while at <= #text do
        local first, found = text:byte(at), nil
        for _, row in ipairs(SEQUENCES) do
            if first >= row[1] and first <= row[2] then found = row end
        end
        if not found or at + found[3] - 1 > #text then return false end
        for index = 2, found[3] do
            local low, high = 0x80, 0xBF
            if index == 2 then low, high = found[4], found[5] end
            local byte = text:byte(at + index - 1)
            if byte < low or byte > high then return false end
        end
        at = at + found[3]
    end
    return true
end

local function name_reason(field_name, text)
    if not is_utf8(text) then return field_name .. "_not_utf8" end
    if text:find("\0", 1, true) then return field_name .. "_nul" end
end

-- Returns why a receiver refuses the header, or nil; PROTOCOL.md, section 7.
local function header_reason(buffer)
    local size = buffer:len()
    if size < FIXED_SIZE then return size == 0 and "empty" or "short" end
    local header_size, nsec = buffer(1, 1):uint(), buffer(12, 4):le_int()
    local topic_end = FIXED_SIZE + buffer(16, 1):uint()
    local link_end = topic_end + buffer(17, 1):uint()
    if header_size < SMALLEST_HEADER then return "header_size_small" end
    if header_size > size then return "header_size_past_end" end
    if header_size % 4 ~= 0 then return "header_size_unaligned" end
    if buffer(7, 1):uint() == 0 then return "parts_zero" end
    if buffer(6, 1):uint() >= buffer(7, 1):uint() then return "part_past_parts" end
    if nsec < 0 then return "nsec_negative" end
    if nsec >= NANOS then return "nsec_too_big" end
    if topic_end > header_size then return "topic_past_header" end
    if link_end > header_size then return "link_past_header" end
    if header_size - link_end > 3 then return "header_size_large" end
    local names = buffer:raw(FIXED_SIZE, link_end - FIXED_SIZE)
    local topic_size = topic_end - FIXED_SIZE
    local reason = name_reason("topic", names:sub(1, topic_size))
        or name_reason("link", names:sub(topic_size + 1))
    if reason then return reason end
    local msg_type = buffer(0, 1):uint()
    if not TYPES[msg_type] and msg_type ~= SEALED then return "unknown_type" end
end

local function body_of(buffer)
    local header_size = buffer(1, 1):uint()
    return header_size < buffer:len() and buffer(header_size):tvb() or nil
end

local function subscribe_reason(body)
    local wanted, rate = TYPES[body(0, 1):uint()], body(4, 4):le_float()
    local is_finite = rate == rate and rate >= 0 and rate < math.huge
    if not wanted or wanted[2] == "" or body(1, 1):uint() > 1 or not is_finite then
        return "body_value"
    end
end

local function is_data(msg_type)
    return TYPES[msg_type] ~= nil and TYPES[msg_type][2] ~= ""
end

-- Counts are of 64 bits and numbers in Lua may be of 53: halves are added, and never wrap.
local function counts_fit(body)
    local low, high = 0, 0
    for at = 24, 56, 8 do
        low, high = low + body(at, 4):le_uint(), high + body(at + 4, 4):le_uint()
    end
    high = high + math.floor(low / 2 ^ 32)
    local has_low, has_high = body(16, 4):le_uint(), body(20, 4):le_uint()
    return high < has_high or (high == has_high and low % 2 ^ 32 <= has_low)
end

-- Returns {offset, size of the name} of each reason in a LinkReport.
local function reasons_of(body)
    local found, at = {}, LINK_REPORT.size
    while at < body:len() do
        if #found == REASONS_MAX or at + 9 > body:len() then return found, "body_size" end
        local size = body(at + 8, 1):uint()
        if at + 9 + size > body:len() then return found, "body_size" end
        local name = body:raw(at + 9, size)
        if size < 1 or size > 32 or name:find("[^a-z0-9_]") then return found, "body_value" end
        table.insert(found, {at, size})
        at = at + 9 + size
    end
    return found, nil
end

-- Returns the numbers of the parts that a request's bitmap asks for.
local function wanted_parts(body)
    local parts = {}
    for at = REQUEST.size, body:len() - 1 do
        local byte = body(at, 1):uint()
        for bit = 0, 7 do
            if math.floor(byte / 2 ^ bit) % 2 == 1 then
                table.insert(parts, (at - REQUEST.size) * 8 + bit)
            end
        end
    end
    return parts
end

local function is_name(body, at, size)
    local text = body:raw(at, size)
    return size > 0 and is_utf8(text) and not text:find("%z")
end

local function is_negative(body, at) return body(at + 7, 1):uint() >= 128 end

local function is_tick(body)
    return not is_negative(body, 16) or body:raw(16, 8) == ("\255"):rep(8)
end

-- Returns what follows the fixed part of a Barrier or a BarrierReply: {offset, size of the name} of
-- each topic, {offset, sizes of the names} of each response, and why it is refused.
local function listed_in(body, responses)
    local sent, due, at, seen = {}, {}, BARRIER.size, {}
    for _ = 1, body(1, 1):uint() do
        if at + SENT.size > body:len() then return sent, due, "body_size" end
        local size = body(at + 1, 1):uint()
        if at + SENT.size + size > body:len() then return sent, due, "body_size" end
        if not is_name(body, at + SENT.size, size) or body(at + 2, 2):le_uint() == 0
            or not is_data(body(at, 1):uint()) then
            return sent, due, "body_value"
        end
        local key = body(at, 1):uint() .. body(at + SENT.size, size):raw()
        if seen[key] then return sent, due, "body_value" end
        seen[key] = true
        table.insert(sent, {at, size})
        at = at + SENT.size + size
    end
    for _ = 1, responses do
        if at + 4 > body:len() then return sent, due, "body_size" end
        local kind, sizes = body(at, 1):uint(), {body(at + 1, 1):uint(), body(at + 2, 1):uint()}
        local name = at + 4
        for _, size in ipairs(sizes) do
            if name + size > body:len() then return sent, due, "body_size" end
            if not is_name(body, name, size) then return sent, due, "body_value" end
            name = name + size
        end
        if kind > 0 and not is_data(kind) then return sent, due, "body_value" end
        table.insert(due, {at, sizes[1], sizes[2]})
        at = name
    end
    return sent, due, at < body:len() and "body_size" or nil
end

local function lockstep_body(body, kind)
    local rows, third = kind == 4 and BARRIER or BARRIER_REPLY, nil
    if body:len() < rows.size then return nil, "body_size" end
    third = body(2, 1):uint()
    local _, _, reason = listed_in(body, kind == 4 and third or 0)
    local is_bad = not is_tick(body) or (kind == 5 and third > 3)
    return rows, reason or (is_bad and "body_value" or nil)
end

local function run_command_body(body)
    if body:len() ~= RUN_COMMAND.size then return nil, "body_size" end
    local action, ticks = body(1, 1):uint(), body(4, 4):le_uint()
    return RUN_COMMAND, (action > 4 or (action == 3) ~= (ticks > 0)) and "body_value" or nil
end

local function run_command_reply_body(body)
    local size = body:len() - RUN_COMMAND_REPLY.size
    if size < 0 or size > RUN_COMMAND_REPLY.text_max then return nil, "body_size" end
    local is_bad = body(1, 1):uint() > 2 or not is_tick(body)
        or (size > 0 and not is_name(body, RUN_COMMAND_REPLY.size, size))
    return RUN_COMMAND_REPLY, is_bad and "body_value" or nil
end

local function control_body(body)
    local kind, rows = body(0, 1):uint(), nil
    if kind == 0 then rows = CREDIT elseif kind == 1 then rows = TOPIC_REPORT end
    if kind == 3 then
        return CREDIT_REQUEST, body:len() ~= CREDIT_REQUEST.size and "body_size" or nil
    end
    if kind == 2 then
        if body:len() < LINK_REPORT.size then return nil, "body_size" end
        local _, reason = reasons_of(body)
        return LINK_REPORT, reason
    end
    if kind == 4 or kind == 5 then return lockstep_body(body, kind) end
    if kind == 6 then return run_command_body(body) end
    if kind == 7 then return run_command_reply_body(body) end
    if kind == 8 or kind == 9 then
        if body:len() ~= ADDRESS_CHALLENGE.size then return nil, "body_size" end
        return kind == 8 and ADDRESS_CHALLENGE or ADDRESS_RESPONSE, nil
    end
    if kind == 10 or kind == 11 then
        if body:len() < WORLD_QUERY.size then return nil, "body_size" end
        return kind == 10 and WORLD_QUERY or WORLD_REPLY, nil
    end
    if not rows then return nil, "body_value" end
    if body:len() ~= rows.size then return nil, "body_size" end
    local is_bad = kind == 1 and not counts_fit(body)
    return rows, (is_bad or not TYPES[body(1, 1):uint()]) and "body_value" or nil
end

local function resend_body(body)
    if body:len() < OFFER.size then return nil, "body_size" end
    local kind, parts_max, count = body(0, 1):uint(), body(2, 1):uint(), body(3, 1):uint()
    if kind > 1 or not is_data(body(1, 1):uint()) then return nil, "body_value" end
    local bitmap = kind == 1 and math.ceil(parts_max / 8) or 0
    if body:len() ~= OFFER.size + bitmap then return nil, "body_size" end
    if kind == 0 then return OFFER, parts_max == 0 and "body_value" or nil end
    local parts = wanted_parts(body)
    local most = parts_max > 0 and 1 or WHOLE_MAX
    local is_bad = count < 1 or count > most or (#parts > 0) ~= (parts_max > 0)
        or (#parts > 0 and parts[#parts] >= parts_max)
    return REQUEST, is_bad and "body_value" or nil
end

local function symbol_body(body)
    if body:len() <= SYMBOL.size or body:len() % 8 ~= 0 then return nil, "body_size" end
    local parts_max, size = body(1, 1):uint(), body:len() - SYMBOL.size
    local needed = math.ceil(body(4, 4):le_uint() / size)
    if not is_data(body(0, 1):uint()) or parts_max == 0 or parts_max ~= needed then
        return SYMBOL, "body_value"
    end
    return SYMBOL, body(2, 1):uint() ~= RAPTORQ and "repair_code" or nil
end

-- Returns the layout of a body of the bridge's own types, and why a receiver refuses it.
local function own_body(msg_type, parts_max, body)
    if msg_type == CONTROL or msg_type == RESEND then
        if parts_max ~= 1 then return nil, "parts_max" end
        if not body then return nil, "body_size" end
        if msg_type == CONTROL then return control_body(body) end
        return resend_body(body)
    end
    if msg_type == REPAIR then
        if not body then return nil, "body_size" end
        return symbol_body(body)
    end
    if msg_type ~= SUBSCRIBE then return nil, nil end
    if parts_max ~= 1 then return nil, "parts_max" end
    if not body or body:len() ~= SUBSCRIBE_BODY.size then return nil, "body_size" end
    return SUBSCRIBE_BODY, subscribe_reason(body)
end

-- Returns the size of the ROS type's name in a Typed body, or nil where it has no valid name.
-- A name that does not end within part 0 is not judged.
local function typed_name(body)
    local size = body:len() > 0 and body(0, 1):uint() or 0
    if 1 + size > body:len() then return nil end
    local name = body:raw(1, size)
    return name:find("^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$") and size or nil
end

local function show_typed(body, parts_max, tree)
    local size = body and typed_name(body)
    if size then
        tree:add(fields["typed.name_size"], body(0, 1))
        tree:add(fields["typed.ros_type"], body(1, size))
    end
    local is_cut = not size or math.ceil((1 + size) / 8) * 8 > body:len()
    if is_cut and parts_max == 1 then return "type_name" end
end

local function show_header(buffer, tree)
    local size = buffer:len()
    local function add(name, at, length)
        if at + length <= size then tree:add_le(fields[name], buffer(at, length)) end
    end
    add("msg_type", 0, 1)
    add("header_size", 1, 1)
    add("seq_number", 2, 4)
    add("part_number", 6, 1)
    add("parts_max", 7, 1)
    add("time_sec", 8, 4)
    add("time_nsec", 12, 4)
    add("topic_size", 16, 1)
    add("link_size", 17, 1)
end

local function show_names(buffer, tree)
    local row = TYPES[buffer(0, 1):uint()]
    local topic_size, link_size = buffer(16, 1):uint(), buffer(17, 1):uint()
    local link_at = FIXED_SIZE + topic_size
    local stamp = NSTime.new(buffer(8, 4):le_int(), buffer(12, 4):le_int())
    tree:add(fields.stamp, buffer(8, 8), stamp)
    tree:add_packet_field(fields.topic, buffer(FIXED_SIZE, topic_size), ENC_UTF_8)
    tree:add_packet_field(fields.link, buffer(link_at, link_size), ENC_UTF_8)
    local padding = buffer(1, 1):uint() - link_at - link_size
    if padding > 0 then tree:add(fields.padding, buffer(link_at + link_size, padding)) end
    if row[2] ~= "" then tree:add(fields.ros_type, row[2]):set_generated() end
    if topic_size == 0 and row[3] ~= "" then
        tree:add(fields.default_topic, row[3]):set_generated()
    end
    local topic = topic_size > 0 and buffer(FIXED_SIZE, topic_size):string(ENC_UTF_8) or row[3]
    return row[1], topic
end

local function show_refusal(tree, reason)
    tree:add(fields.refused, reason):set_generated()
    tree:add_proto_expert_info(refused_expert, "A receiver refuses this datagram: " .. reason)
end

-- Where the first captured part of each message of several parts was seen.
local first_parts = {}

local function show_first_part(buffer, info, tree)
    local names = FIXED_SIZE + buffer(16, 1):uint()
    local key = tostring(info.src) .. ":" .. info.src_port .. ">" .. tostring(info.dst) .. ":"
        .. info.dst_port .. " " .. buffer:raw(0, 1) .. buffer:raw(2, 4) .. buffer:raw(8, names - 8)
    if not first_parts[key] then first_parts[key] = info.number end
    tree:add(fields.first_part, first_parts[key]):set_generated()
end

local function show_rows(rows, body, tree)
    for _, row in ipairs(rows) do tree:add_le(fields[row.name], body(row[1], row[2])) end
end

local function show_listed(body, responses, tree)
    local sent, due = listed_in(body, responses)
    for _, place in ipairs(sent) do
        for _, row in ipairs(SENT) do
            tree:add_le(fields[row.name], body(place[1] + row[1], row[2]))
        end
        tree:add_packet_field(fields["sent.topic"], body(place[1] + SENT.size, place[2]), ENC_UTF_8)
    end
    for _, place in ipairs(due) do
        local name = place[1] + 4
        tree:add(fields["response.msg_type"], body(place[1], 1))
        tree:add(fields["response.every"], body(place[1] + 3, 1))
        tree:add_packet_field(fields["response.topic"], body(name, place[2]), ENC_UTF_8)
        tree:add_packet_field(fields["response.of"], body(name + place[2], place[3]), ENC_UTF_8)
    end
end

-- Shows the text of a world query or its reply. It is not judged: a receiver does that later.
local function show_world_text(packed, tree)
    tree:add(fields["world_text.packed"], packed)
    for _, name in ipairs({"uncompress_zlib", "uncompress"}) do  -- renamed in Wireshark 4.4
        local is_done, text = pcall(function() return packed[name](packed, "Text") end)
        if is_done and text then
            tree:add_packet_field(fields["world_text.text"], text, ENC_UTF_8)
            return
        end
    end
end

local function show_body(buffer, tree)
    local msg_type, parts_max = buffer(0, 1):uint(), buffer(7, 1):uint()
    local body = body_of(buffer)
    tree:add(fields.fragment_size, body and body:len() or 0):set_generated()
    local rows, reason = own_body(msg_type, parts_max, body)
    if parts_max > 1 and not body then reason = "part_size" end
    if body and msg_type == CONTROL then tree:add(fields["control.kind"], body(0, 1)) end
    if body and msg_type == RESEND then tree:add(fields["resend.kind"], body(0, 1)) end
    if rows then
        show_rows(rows, body, tree)
    elseif body then
        tree:add(fields.fragment, body())
    end
    if msg_type == TYPED and buffer(6, 1):uint() == 0 then
        reason = reason or show_typed(body, parts_max, tree)
    end
    if rows == LINK_REPORT then
        for _, place in ipairs((reasons_of(body))) do
            tree:add(fields["link_report.reason"], body(place[1] + 9, place[2]))
            tree:add_le(fields["link_report.reason_count"], body(place[1], 8))
        end
    elseif rows == BARRIER or rows == BARRIER_REPLY then
        show_listed(body, rows == BARRIER and body(2, 1):uint() or 0, tree)
    elseif rows == RUN_COMMAND_REPLY and body:len() > RUN_COMMAND_REPLY.size then
        tree:add_packet_field(fields["run_command_reply.error"], body(RUN_COMMAND_REPLY.size), ENC_UTF_8)
    elseif (rows == WORLD_QUERY or rows == WORLD_REPLY) and body:len() > rows.size then
        show_world_text(body(rows.size), tree)
    elseif rows == REQUEST and body:len() > REQUEST.size then
        local parts = table.concat(wanted_parts(body), " ")
        tree:add(fields["request.parts"], body(REQUEST.size), parts)
    elseif rows == SYMBOL then
        tree:add(fields["symbol.data"], body(SYMBOL.size))
    end
    return reason
end

function proto.init() first_parts = {} end

local show

-- Shows a sealed datagram. Its tag is not checked: that needs the key.
local function show_sealed(buffer, info, root, tree)
    if buffer:len() < SEALED_HEAD + TAG_SIZE then
        show_refusal(tree, "bad_tag")
        return "Sealed, refused: bad_tag"
    end
    local inner = buffer:len() - SEALED_HEAD - TAG_SIZE
    show_rows(SEAL, buffer, tree)
    tree:add(fields["sealed.tag"], buffer(SEALED_HEAD + inner))
    if inner == 0 then return "Sealed, empty" end
    return "Sealed: " .. show(buffer(SEALED_HEAD, inner):tvb(), info, root)
end

-- Shows one datagram and returns it in a line.
function show(buffer, info, root)
    local tree = root:add(proto, buffer(), "UDP Bridge")
    show_header(buffer, tree)
    local reason = header_reason(buffer)
    if reason then
        show_refusal(tree, reason)
        return "refused: " .. reason
    end
    if buffer(0, 1):uint() == SEALED then return show_sealed(buffer, info, root, tree) end
    local name, topic = show_names(buffer, tree)
    local seq_number, parts_max = buffer(2, 4):le_uint(), buffer(7, 1):uint()
    local summary = name .. " #" .. seq_number .. " " .. topic
    if parts_max > 1 then
        summary = summary .. " part " .. buffer(6, 1):uint() .. " of " .. parts_max
        show_first_part(buffer, info, tree)
    end
    reason = show_body(buffer, tree)
    if reason then
        summary = summary .. ", refused: " .. reason
        show_refusal(tree, reason)
    end
    tree:append_text(", " .. summary)
    return summary
end

function proto.dissector(buffer, info, root)
    info.cols.protocol = "UDPBridge"
    info.cols.info = show(buffer, info, root)
    return buffer:len()
end

-- Every datagram on these ports is dissected, so that malformed ones are shown; on other ports only a
-- datagram with a valid header is.
proto.prefs.ports = Pref.range("UDP ports", "7510-7511", "Ports of gateway and node", 65535)

local udp_ports = DissectorTable.get("udp.port")
local registered = nil

local function register()
    if registered then udp_ports:remove(registered, proto) end
    registered = proto.prefs.ports
    udp_ports:add(registered, proto)
end

function proto.prefs_changed() register() end

register()

proto:register_heuristic("udp", function(buffer, info, root)
    if header_reason(buffer) then return false end
    proto.dissector(buffer, info, root)
    return true
end)
