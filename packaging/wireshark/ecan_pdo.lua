-- PDO images of ECAN-Lite gateways in captures of the program ecan (link type USER0): fixed header
-- (manual 6), channel status words (7), packets (8), TX_RESULT (10). For Wireshark and tshark 4.0
-- and later; README.md describes the installation.

local ecan = Proto("ecan_pdo", "ECAN-Lite process data")

local DIRECTIONS = { [0] = "RxPDO, from the master", [1] = "TxPDO, from the gateway" }
local ENCAPSULATIONS = {
    [0] = "compact", [1] = "compact, delta16 time stamps",
    [4] = "64 byte window", [5] = "64 byte window, delta16 time stamps",
}
local BUDGETS = { [0] = "balanced", [1] = "shared only", [2] = "deterministic", [3] = "reserved" }
local CRC_ALGORITHMS = { [0] = "none", [1] = "CRC-16/CCITT-FALSE" }
local STATES = {
    [0] = "disabled", [1] = "init", [2] = "run", [3] = "bus-off", [4] = "error", [5] = "listen",
}
local KINDS = { [0] = "CAN_FRAME", [1] = "TX_RESULT", [2] = "STREAM_META", [3] = "reserved" }
local TIME_FORMATS = { [0] = "none", [1] = "delta16", [2] = "delta32", [3] = "full64" }
local RESULTS = {
    [0] = "OK", [1] = "queued", [2] = "bus busy", [3] = "invalid channel", [4] = "tx fifo full",
    [5] = "bus off",
}
local RX_AUX = { [0] = "FIFO0", [1] = "FIFO1", [2] = "RXBUF", [3] = "high priority" }
local TX_AUX = { [0] = "normal", [1] = "high priority", [2] = "dedicated buffer", [3] = "queue hint" }
local FD_LENGTHS = { [9] = 12, [10] = 16, [11] = 20, [12] = 24, [13] = 32, [14] = 48, [15] = 64 }

local fields = {}

-- Defines a field of ecan_pdo and stores it in fields[name].
local function field(kind, name, label, ...)
    fields[name] = ProtoField[kind]("ecan_pdo." .. name, label, ...)
end

local function flag(kind, name, label, bits, mask)
    fields[name] = ProtoField.bool("ecan_pdo." .. name, label, bits, nil, mask)
end

-- Capture header
field("uint8", "capture.version", "Version of the capture header", base.DEC)
field("uint8", "capture.length", "Length of the capture header", base.DEC)
field("uint8", "direction", "Direction", base.DEC, DIRECTIONS)
field("uint16", "slave", "Slave", base.DEC)
field("uint32", "profile", "Profile word", base.HEX)
field("uint32", "profile.n", "Chunks of 128 bytes, less one", base.DEC, nil, 0x1F)
field("uint32", "profile.channels", "Channels", base.HEX, nil, 0x1FE0)
field("uint32", "profile.encapsulation", "Encapsulation", base.DEC, ENCAPSULATIONS, 0x7E000)
field("uint32", "profile.budget", "Budget", base.DEC, BUDGETS, 0x180000)
flag("bool", "profile.tx_result", "TX_RESULT", 32, 0x00200000)
flag("bool", "profile.align4", "ALIGN_4", 32, 0x00400000)
flag("bool", "profile.no_crc16", "NO_CRC16", 32, 0x00800000)
flag("bool", "profile.app_bypass", "APP_BYPASS", 32, 0x01000000)
flag("bool", "profile.payload_only", "PAYLOAD_ONLY", 32, 0x02000000)

-- Fixed header
field("uint8", "version", "Version", base.DEC, nil, 0xF0)
field("uint8", "ihl", "Header length in words of 4 bytes", base.DEC, nil, 0x0F)
field("uint8", "flags", "Flags", base.HEX)
flag("bool", "flags.stream_truncated", "STREAM_TRUNCATED", 8, 0x01)
flag("bool", "flags.any_channel_error", "ANY_CHANNEL_ERROR", 8, 0x02)
flag("bool", "flags.tx_result_present", "TX_RESULT_PRESENT", 8, 0x04)
flag("bool", "flags.status_changed", "STATUS_CHANGED", 8, 0x08)
flag("bool", "flags.seq_wrap", "SEQ_WRAP", 8, 0x10)
flag("bool", "flags.overflow_sat_valid", "OVERFLOW_SAT_VALID", 8, 0x20)
field("uint16", "seq_begin", "Sequence at the beginning", base.DEC)
field("uint16", "seq_end", "Sequence at the end", base.DEC)
field("uint16", "payload_len", "Payload length", base.DEC)
field("uint16", "payload_crc16", "Payload CRC", base.HEX)
field("uint16", "layout_id", "Layout", base.HEX)
field("uint8", "channel_mask", "Channels", base.HEX)
field("uint8", "frame_count", "Packets", base.DEC)
field("uint8", "overflow_sat", "Overflow", base.DEC)
field("uint8", "crc_alg", "CRC algorithm", base.DEC, CRC_ALGORITHMS)

-- Channel status word
field("uint16", "status", "Channel status", base.HEX)
field("uint16", "status.state", "State", base.DEC, STATES, 0x0007)
flag("bool", "status.fd_enabled", "CAN FD", 16, 0x0008)
flag("bool", "status.warn", "Warning", 16, 0x0010)
flag("bool", "status.bus_off", "Bus-off", 16, 0x0020)
flag("bool", "status.rx_pressure", "Receive pressure", 16, 0x0040)
flag("bool", "status.tx_pressure", "Send pressure", 16, 0x0080)
flag("bool", "status.detail_pending", "Details pending", 16, 0x0100)
flag("bool", "status.counter_sat", "Counters saturated", 16, 0x0200)
field("uint16", "status.rx_pending", "Receive pending", base.DEC, nil, 0x1C00)
field("uint16", "status.tx_pending", "Send pending", base.DEC, nil, 0xE000)

-- Packets
field("uint16", "ctrl", "Control", base.HEX)
field("uint16", "channel", "Channel", base.DEC, nil, 0x0007)
field("uint16", "dlc", "DLC", base.DEC, nil, 0x0078)
flag("bool", "ide", "Extended identifier", 16, 0x0080)
flag("bool", "fdf", "CAN FD", 16, 0x0100)
flag("bool", "brs", "Bit rate switch", 16, 0x0200)
flag("bool", "rtr", "Remote frame", 16, 0x0400)
flag("bool", "esi", "Error state indicator", 16, 0x0400)
field("uint16", "tsf", "Time format", base.DEC, TIME_FORMATS, 0x1800)
field("uint16", "kind", "Kind", base.DEC, KINDS, 0x6000)
flag("bool", "d64", "64 byte window", 16, 0x8000)
fields["id"] = ProtoField.uint32("ecan_pdo.id", "CAN ID", base.HEX)
field("uint8", "id_aux", "Receive source", base.DEC, RX_AUX)
fields["id_aux_tx"] = ProtoField.uint8("ecan_pdo.id_aux_tx", "Send hint", base.DEC, TX_AUX)
field("uint16", "time.delta16", "Time stamp", base.DEC)
field("uint32", "time.delta32", "Time stamp", base.DEC)
field("uint64", "time.full64", "Time stamp", base.DEC)
field("uint8", "schedule.format", "Schedule format", base.DEC)
field("uint8", "schedule.flags", "Schedule flags", base.HEX)
field("uint16", "schedule.tag", "Schedule tag", base.DEC)
field("uint32", "schedule.offset_ns", "Offset from SYNC0 in ns", base.DEC)
field("bytes", "data", "Data")
field("bytes", "padding", "Padding")
field("uint16", "result.sequence", "Sequence of the RxPDO", base.DEC)
field("uint8", "result.frame", "Frame in the RxPDO", base.DEC)
field("uint8", "result.code", "Result", base.DEC, RESULTS)

local field_list = {}
for _, it in pairs(fields) do
    field_list[#field_list + 1] = it
end
ecan.fields = field_list

local severity = { error = expert.severity.ERROR, warn = expert.severity.WARN, note = expert.severity.NOTE }
local experts = {}

local function fault(name, text, group, level)
    experts[name] = ProtoExpert.new("ecan_pdo.fault." .. name, text, group, severity[level])
end

fault("short", "The image is truncated", expert.group.MALFORMED, "error")
fault("capture", "Not a capture header of version 1", expert.group.UNDECODED, "error")
fault("version", "Not a fixed header of version 1 with 24 bytes", expert.group.MALFORMED, "error")
fault("sequence", "The sequences differ: torn image, not valid", expert.group.SEQUENCE, "warn")
fault("length", "The payload is longer than the frame area", expert.group.MALFORMED, "error")
fault("crc", "The CRC of the payload is wrong", expert.group.CHECKSUM, "error")
fault("crc_alg", "The CRC algorithm does not match the profile", expert.group.PROTOCOL, "error")
fault("layout", "The layout does not match the profile", expert.group.PROTOCOL, "warn")
fault("overflow", "The data of this cycle are incomplete", expert.group.SEQUENCE, "warn")
fault("bus_off", "The channel is bus-off", expert.group.PROTOCOL, "warn")
fault("kind", "Unknown packet kind", expert.group.UNDECODED, "error")
fault("packet", "The packet exceeds the payload", expert.group.MALFORMED, "error")
fault("count", "The number of packets does not match the header", expert.group.PROTOCOL, "error")
fault("result", "The gateway has rejected the frame", expert.group.RESPONSE_CODE, "note")

local expert_list = {}
for _, it in pairs(experts) do
    expert_list[#expert_list + 1] = it
end
ecan.experts = expert_list

-- Bit access by division, for all versions of Lua.
local function bits(value, first, count)
    return math.floor(value / 2 ^ first) % 2 ^ count
end

local crc_table = {}
for byte = 0, 255 do
    local crc = byte * 256
    for _ = 1, 8 do
        local is_set = crc >= 0x8000
        crc = (crc * 2) % 0x10000
        if is_set then
            crc = bit.bxor(crc, 0x1021)
        end
    end
    crc_table[byte] = crc
end

local function crc16(range)
    local bytes, crc = range:bytes(), 0xFFFF
    for i = 0, bytes:len() - 1 do
        local index = bit.bxor(bits(crc, 8, 8), bytes:get_index(i))
        crc = bit.bxor((crc * 256) % 0x10000, crc_table[index])
    end
    return crc
end

local function add_all(tree, range, names)
    for _, name in ipairs(names) do
        tree:add_le(fields[name], range)
    end
end

local function dissect_profile(tree, range)
    local word = range:le_uint()
    add_all(tree:add_le(fields["profile"], range), range, {
        "profile.n", "profile.channels", "profile.encapsulation", "profile.budget",
        "profile.tx_result", "profile.align4", "profile.no_crc16", "profile.app_bypass",
        "profile.payload_only",
    })
    return {
        layout_id = bit.bxor(bits(word, 0, 16), bits(word, 16, 16)),
        area = (bits(word, 0, 5) + 1) * 128 - 24,
        has_align4 = bits(word, 22, 1) == 1,
        has_crc = bits(word, 23, 1) == 0,
    }
end

local function dissect_status(tree, range, channel)
    local word = range:le_uint()
    local item = tree:add_le(fields["status"], range)
    local state = STATES[bits(word, 0, 3)] or "unknown"
    item:set_text(string.format("Channel %d: %s (0x%04x)", channel, state, word))
    add_all(item, range, {
        "status.state", "status.fd_enabled", "status.warn", "status.bus_off", "status.rx_pressure",
        "status.tx_pressure", "status.detail_pending", "status.counter_sat", "status.rx_pending",
        "status.tx_pending",
    })
    if bits(word, 5, 1) == 1 then
        item:add_proto_expert_info(experts["bus_off"])
    end
end

-- Dissects the fixed header; returns the values for the packets, with is_valid if they can be parsed.
local function dissect_header(tree, tvb, profile)
    local header = tree:add(ecan, tvb(0, 24), "Fixed header")
    add_all(header, tvb(0, 1), { "version", "ihl" })
    add_all(header:add_le(fields["flags"], tvb(1, 1)), tvb(1, 1), {
        "flags.stream_truncated", "flags.any_channel_error", "flags.tx_result_present",
        "flags.status_changed", "flags.seq_wrap", "flags.overflow_sat_valid",
    })
    header:add_le(fields["seq_begin"], tvb(2, 2))
    local seq_end = header:add_le(fields["seq_end"], tvb(4, 2))
    local payload_item = header:add_le(fields["payload_len"], tvb(6, 2))
    local crc_item = header:add_le(fields["payload_crc16"], tvb(8, 2))
    local layout = header:add_le(fields["layout_id"], tvb(10, 2))
    header:add_le(fields["channel_mask"], tvb(12, 1))
    local count_item = header:add_le(fields["frame_count"], tvb(13, 1))
    local overflow = header:add_le(fields["overflow_sat"], tvb(14, 1))
    local crc_alg_item = header:add_le(fields["crc_alg"], tvb(15, 1))
    for channel = 0, 3 do
        dissect_status(header, tvb(16 + 2 * channel, 2), channel)
    end

    local sequence, length = tvb(2, 2):le_uint(), tvb(6, 2):le_uint()
    local crc_alg = tvb(15, 1):uint()
    local is_valid = true
    local function invalid(item, name)
        item:add_proto_expert_info(experts[name])
        is_valid = false
    end
    if tvb(0, 1):uint() ~= 0x16 then
        invalid(header, "version")
    end
    if sequence ~= tvb(4, 2):le_uint() then
        invalid(seq_end, "sequence")
    end
    if crc_alg ~= (profile.has_crc and 1 or 0) then
        invalid(crc_alg_item, "crc_alg")
    end
    if length > profile.area then
        invalid(payload_item, "length")
    elseif length > tvb:len() - 24 then
        invalid(payload_item, "short")
    elseif crc_alg == 1 then
        local computed = length > 0 and crc16(tvb(24, length)) or 0xFFFF
        if computed == tvb(8, 2):le_uint() then
            crc_item:append_text(" [correct]")
        else
            crc_item:append_text(string.format(" [wrong, computed 0x%04x]", computed))
            invalid(crc_item, "crc")
        end
    end
    if tvb(10, 2):le_uint() ~= profile.layout_id then
        layout:add_proto_expert_info(experts["layout"])
    end
    if tvb(14, 1):uint() > 0 or bits(tvb(1, 1):uint(), 0, 1) == 1 then
        overflow:add_proto_expert_info(experts["overflow"])
    end
    return {
        sequence = sequence, length = length, count = tvb(13, 1):uint(), count_item = count_item,
        is_valid = is_valid,
    }
end

local function control(range)
    local word = range:le_uint()
    return {
        channel = bits(word, 0, 3), dlc = bits(word, 3, 4), is_extended = bits(word, 7, 1) == 1,
        is_fd = bits(word, 8, 1) == 1, x = bits(word, 10, 1) == 1, tsf = bits(word, 11, 2),
        kind = bits(word, 13, 2), has_window = bits(word, 15, 1) == 1,
    }
end

local function data_bytes(ctrl)
    if not ctrl.is_fd and ctrl.x then
        return 0, 0
    end
    local length = ctrl.is_fd and FD_LENGTHS[ctrl.dlc] or math.min(ctrl.dlc, 8)
    -- In the 64 byte window, the DLC defines the number of data bytes.
    return length, ctrl.has_window and 64 or length
end

local TIME_BYTES = { [0] = 0, [1] = 2, [2] = 4, [3] = 8 }

-- Size of a packet without padding in bytes; nil for an unknown kind.
local function packet_bytes(ctrl)
    if ctrl.kind == 0 then
        local _, carried = data_bytes(ctrl)
        return 2 + (ctrl.is_extended and 4 or 2) + TIME_BYTES[ctrl.tsf] + carried
    end
    return ctrl.kind == 1 and 6 or nil
end

local function dissect_time(tree, range, ctrl, is_rx)
    if ctrl.tsf == 3 and is_rx then
        tree:add_le(fields["schedule.format"], range(0, 1))
        tree:add_le(fields["schedule.flags"], range(1, 1))
        tree:add_le(fields["schedule.tag"], range(2, 2))
        tree:add_le(fields["schedule.offset_ns"], range(4, 4))
    elseif ctrl.tsf > 0 then
        local names = { "time.delta16", "time.delta32", "time.full64" }
        tree:add_le(fields[names[ctrl.tsf]], range)
    end
end

-- Dissects a CAN_FRAME; returns a text for the packet list.
local function dissect_frame(tree, range, ctrl, is_rx)
    local id_length = ctrl.is_extended and 4 or 2
    local id_bits = ctrl.is_extended and 29 or 11
    local id_range = range(2, id_length)
    local id = bits(id_range:le_uint(), 0, id_bits)
    tree:add(fields["id"], id_range, id)
    local aux = is_rx and "id_aux_tx" or "id_aux"
    tree:add(fields[aux], id_range, bits(id_range:le_uint(), id_bits, 3))
    local at = 2 + id_length
    local time = TIME_BYTES[ctrl.tsf]
    if time > 0 then
        dissect_time(tree, range(at, time), ctrl, is_rx)
    end
    at = at + time
    local length = data_bytes(ctrl)
    local text = string.format(ctrl.is_extended and "%d:%08X" or "%d:%03X", ctrl.channel, id)
    if not ctrl.is_fd and ctrl.x then
        return text .. "#R"
    end
    text = text .. (ctrl.is_fd and "##" or "#")
    if length == 0 then
        return text
    end
    tree:add(fields["data"], range(at, length))
    return text .. tostring(range(at, length):bytes())
end

local function dissect_result(tree, range, ctrl)
    tree:add_le(fields["result.sequence"], range(2, 2))
    tree:add_le(fields["result.frame"], range(4, 1))
    local item = tree:add_le(fields["result.code"], range(5, 1))
    local code = range(5, 1):uint()
    if code > 1 then
        item:add_proto_expert_info(experts["result"])
    end
    local words = RESULTS[code] or "unknown"
    return string.format("%d:%d.%d %s", ctrl.channel, range(2, 2):le_uint(), range(4, 1):uint(), words)
end

-- Dissects all packets of the payload; returns their texts.
local function dissect_packets(tree, payload, profile, is_rx)
    local at, texts = 0, {}
    while at < payload:len() do
        local rest = payload:len() - at
        if rest < 2 then
            tree:add(ecan, payload(at), "Packet"):add_proto_expert_info(experts["packet"])
            return texts
        end
        local ctrl = control(payload(at, 2))
        local raw = packet_bytes(ctrl)
        local name = string.format("Packet %d: %s", #texts, KINDS[ctrl.kind])
        if not raw then
            tree:add(ecan, payload(at), name):add_proto_expert_info(experts["kind"])
            return texts
        end
        local whole = profile.has_align4 and math.ceil(raw / 4) * 4 or raw
        if whole > rest then
            tree:add(ecan, payload(at), name):add_proto_expert_info(experts["packet"])
            return texts
        end
        local range = payload(at, whole)
        local packet = tree:add(ecan, range, name)
        local names = { "channel", "kind" }
        if ctrl.kind == 0 then
            names = {
                "channel", "dlc", "ide", "fdf", "brs", ctrl.is_fd and "esi" or "rtr", "tsf", "kind",
                "d64",
            }
        end
        add_all(packet:add_le(fields["ctrl"], range(0, 2)), range(0, 2), names)
        local dissect = ctrl.kind == 0 and dissect_frame or dissect_result
        local text = dissect(packet, range, ctrl, is_rx)
        packet:append_text(", " .. text)
        if whole > raw then
            packet:add(fields["padding"], range(raw))
        end
        texts[#texts + 1] = text
        at = at + whole
    end
    return texts
end

function ecan.dissector(tvb, pinfo, root)
    if tvb:len() < 16 or tvb(0, 4):string() ~= "ECAN" then
        return 0
    end
    pinfo.cols.protocol = "ECAN-PDO"
    local tree = root:add(ecan, tvb())
    local length = tvb(5, 1):uint()
    local capture = tree:add(ecan, tvb(0, math.min(length, tvb:len())), "Capture header")
    capture:add(fields["capture.version"], tvb(4, 1))
    capture:add(fields["capture.length"], tvb(5, 1))
    if tvb(4, 1):uint() ~= 1 or length < 16 then
        capture:add_proto_expert_info(experts["capture"])
        return tvb:len()
    end
    capture:add(fields["direction"], tvb(6, 1))
    capture:add_le(fields["slave"], tvb(8, 2))
    local profile = dissect_profile(capture, tvb(12, 4))
    if tvb:len() < length + 24 then
        tree:add_proto_expert_info(experts["short"])
        return tvb:len()
    end
    local is_rx = tvb(6, 1):uint() == 0
    local image = tvb(length):tvb()
    local header = dissect_header(tree, image, profile)
    local texts = {}
    if header.is_valid and header.length > 0 then
        texts = dissect_packets(tree, image(24, header.length), profile, is_rx)
    end
    if header.is_valid and #texts ~= header.count then
        header.count_item:add_proto_expert_info(experts["count"])
    end
    pinfo.cols.info = string.format("%s slave %d, sequence %d%s  %s", is_rx and "RxPDO" or "TxPDO",
        tvb(8, 2):le_uint(), header.sequence, header.is_valid and "" or ", not valid",
        table.concat(texts, "  "))
    return tvb:len()
end

local encapsulations = wtap_encaps or wtap
DissectorTable.get("wtap_encap"):add(encapsulations.USER0, ecan)
