#include "candump_line.h"

#include <inttypes.h>
#include <stdlib.h>

#define NS_PER_S 1000000000u

/* Position in the line, and the fault there. */
typedef struct {
    const char *at;
    const char *fault;
} cursor_t;

static bool fail(cursor_t *cursor, const char *fault)
{
    cursor->fault = fault;
    return false;
}

static bool is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static bool at_field_end(const cursor_t *cursor)
{
    return *cursor->at == '\0' || is_blank(*cursor->at);
}

static bool take_blanks(cursor_t *cursor)
{
    const char *start = cursor->at;
    while (is_blank(*cursor->at)) {
        cursor->at++;
    }
    return cursor->at != start || fail(cursor, "expected a blank");
}

/* Also skips blanks. */
static bool at_line_end(cursor_t *cursor)
{
    while (is_blank(*cursor->at)) {
        cursor->at++;
    }
    return *cursor->at == '\0';
}

static bool take(cursor_t *cursor, char expected)
{
    bool is_there = *cursor->at == expected;
    cursor->at += is_there;
    return is_there;
}

/* Value of a hexadecimal digit; -1 for other characters. */
static int take_hex(cursor_t *cursor)
{
    char c = *cursor->at;
    int value = is_digit(c)               ? c - '0'
                : (c >= 'A' && c <= 'F') ? c - 'A' + 10
                : (c >= 'a' && c <= 'f') ? c - 'a' + 10
                                         : -1;
    cursor->at += value >= 0;
    return value;
}

/* "(1398128223.803317)", with 6 or 9 decimals */
static bool read_time(cursor_t *cursor, uint64_t *time_ns)
{
    uint64_t seconds = 0, fraction = 0;
    int digits = 0;
    if (!take(cursor, '(') || !is_digit(*cursor->at)) {
        return fail(cursor, "expected `(` and a time stamp");
    }
    for (; is_digit(*cursor->at); cursor->at++) {
        seconds = seconds * 10 + (uint64_t)(*cursor->at - '0');
        if (seconds >= UINT64_MAX / NS_PER_S) {
            return fail(cursor, "the time stamp is beyond 64 bits of nanoseconds");
        }
    }
    if (!take(cursor, '.')) {
        return fail(cursor, "expected the decimals of the time stamp");
    }
    for (; is_digit(*cursor->at) && digits < 9; cursor->at++, digits++) {
        fraction = fraction * 10 + (uint64_t)(*cursor->at - '0');
    }
    if ((digits != 6 && digits != 9) || !take(cursor, ')')) {
        return fail(cursor, "expected 6 or 9 decimals of the time stamp, then `)`");
    }
    *time_ns = seconds * NS_PER_S + (digits == 6 ? fraction * 1000 : fraction);
    return true;
}

static bool read_interface(cursor_t *cursor, unsigned *interface)
{
    if (at_field_end(cursor)) {
        return fail(cursor, "expected the name of an interface");
    }
    while (!at_field_end(cursor) && !is_digit(*cursor->at)) {
        cursor->at++;
    }
    *interface = (unsigned)strtoul(cursor->at, NULL, 10);
    while (!at_field_end(cursor)) {
        cursor->at++;
    }
    return true;
}

/* 3 or 8 hexadecimal digits, then `#` */
static bool read_identifier(cursor_t *cursor, uint32_t *id, uint8_t *flags)
{
    int digits = 0, digit;
    *id = 0;
    while (digits < 8 && (digit = take_hex(cursor)) >= 0) {
        *id = *id << 4 | (uint32_t)digit;
        digits++;
    }
    if ((digits != 3 && digits != 8) || !take(cursor, '#')) {
        return fail(cursor, "expected a CAN ID of 3 or 8 hex digits, then `#`");
    }
    *flags = digits == 8 ? IGH_MCAN_FLAG_EXT : 0;
    return true;
}

static bool read_data(cursor_t *cursor, uint8_t *data, size_t limit, size_t *length)
{
    for (*length = 0; !at_field_end(cursor); ++*length) {
        int high = take_hex(cursor);
        int low = high >= 0 ? take_hex(cursor) : -1;
        if (low < 0) {
            return fail(cursor, "expected data bytes of two hex digits each");
        }
        if (*length == limit) {
            return fail(cursor, "too many data bytes");
        }
        data[*length] = (uint8_t)(high << 4 | low);
    }
    return true;
}

/* "166#D0320009", "166#R4", "166##1D0320009"; the SDK checks the frame. */
static bool read_frame(cursor_t *cursor, igh_mcan_tx_frame_t *frame)
{
    enum { LOG_BRS = 1, LOG_ESI = 2, LOG_FDF = 4 };
    uint8_t data[ECAN_CANFD_MAX_BYTES], flags;
    uint32_t id;
    size_t length = 0;
    int result;
    if (!read_identifier(cursor, &id, &flags)) {
        return false;
    }
    const char *start = cursor->at;
    if (take(cursor, '#')) {
        int log_flags = take_hex(cursor);
        if (log_flags < 0 || (log_flags & ~(LOG_BRS | LOG_ESI | LOG_FDF)) != 0) {
            return fail(cursor, "expected the flags of a CAN FD frame, a hex digit up to 7");
        }
        flags |= (log_flags & LOG_BRS) != 0 ? IGH_MCAN_FLAG_BRS : 0;
        flags |= (log_flags & LOG_ESI) != 0 ? IGH_MCAN_FLAG_ESI : 0;
        if (!read_data(cursor, data, ECAN_CANFD_MAX_BYTES, &length)) {
            return false;
        }
        result = igh_mcan_tx_frame_set_canfd(frame, 0, 0, id, flags, data, length);
    } else if (take(cursor, 'R')) {
        length = is_digit(*cursor->at) ? (size_t)(*cursor->at++ - '0') : 0;
        if (!at_field_end(cursor)) {
            return fail(cursor, "expected the DLC of a remote frame, 0 to 8");
        }
        flags |= IGH_MCAN_FLAG_RTR;
        result = igh_mcan_tx_frame_set_can(frame, 0, 0, id, flags, NULL, length);
    } else {
        if (!read_data(cursor, data, 8, &length)) {
            return false;
        }
        result = igh_mcan_tx_frame_set_can(frame, 0, 0, id, flags, data, length);
    }
    if (result != ECAN_OK) {
        cursor->at = start;
        return fail(cursor, ecan_last_error());
    }
    return true;
}

/* A direction may follow the frame: R or T. */
static bool read_end(cursor_t *cursor)
{
    if (at_line_end(cursor)) {
        return true;
    }
    if (*cursor->at == 'R' || *cursor->at == 'T') {
        cursor->at++;
    }
    return at_line_end(cursor) || fail(cursor, "expected the end of the line");
}

candump_line_t candump_line_read(const char *line, candump_record_t *record,
                                 candump_fault_t *fault)
{
    cursor_t cursor = {.at = line};
    if (at_line_end(&cursor) || *cursor.at == '#') {
        return CANDUMP_LINE_EMPTY;
    }
    if (read_time(&cursor, &record->time_ns) && take_blanks(&cursor) &&
        read_interface(&cursor, &record->interface) && take_blanks(&cursor) &&
        read_frame(&cursor, &record->frame) && read_end(&cursor)) {
        return CANDUMP_LINE_RECORD;
    }
    fault->text = cursor.fault;
    fault->column = (size_t)(cursor.at - line) + 1;
    return CANDUMP_LINE_FAULT;
}

bool candump_line_write(FILE *file, uint64_t time_ns, size_t interface,
                        const igh_mcan_rx_frame_t *frame)
{
    bool is_extended = (frame->flags & IGH_MCAN_FLAG_EXT) != 0;
    uint64_t seconds = time_ns / NS_PER_S, nanoseconds = time_ns % NS_PER_S;
    if (nanoseconds % 1000 == 0) {
        fprintf(file, "(%010" PRIu64 ".%06" PRIu64 ")", seconds, nanoseconds / 1000);
    } else {
        fprintf(file, "(%010" PRIu64 ".%09" PRIu64 ")", seconds, nanoseconds);
    }
    fprintf(file, " can%zu %0*" PRIX32 "#", interface, is_extended ? 8 : 3, frame->can_id);
    if ((frame->flags & IGH_MCAN_FLAG_RTR) != 0) {
        fputc('R', file);
        if (frame->len > 0) {
            fprintf(file, "%u", frame->len);
        }
    } else {
        if ((frame->flags & IGH_MCAN_FLAG_FD) != 0) {
            bool brs = (frame->flags & IGH_MCAN_FLAG_BRS) != 0;
            bool esi = (frame->flags & IGH_MCAN_FLAG_ESI) != 0;
            fprintf(file, "#%d", (brs ? 1 : 0) | (esi ? 2 : 0));
        }
        for (size_t i = 0; i < frame->len; i++) {
            fprintf(file, "%02X", frame->data[i]);
        }
    }
    fputc('\n', file);
    return !ferror(file);
}
