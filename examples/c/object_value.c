#include "object_value.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "options.h"
#include "report.h"

bool object_type_parse(const char *name, object_type_t *type)
{
    static const struct {
        const char *name;
        object_type_t type;
    } types[] = {
        {"u8", {OBJECT_UNSIGNED, 1}},  {"u16", {OBJECT_UNSIGNED, 2}}, {"u32", {OBJECT_UNSIGNED, 4}},
        {"u64", {OBJECT_UNSIGNED, 8}}, {"i8", {OBJECT_SIGNED, 1}},    {"i16", {OBJECT_SIGNED, 2}},
        {"i32", {OBJECT_SIGNED, 4}},   {"i64", {OBJECT_SIGNED, 8}},   {"hex", {OBJECT_HEX, 0}},
        {"string", {OBJECT_STRING, 0}},
    };
    for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++) {
        if (strcmp(name, types[i].name) == 0) {
            *type = types[i].type;
            return true;
        }
    }
    return false;
}

static bool encode_number(object_type_t type, const char *text, uint8_t *data)
{
    bool is_negative = text[0] == '-';
    /* Signed types: the bits below the sign. */
    uint64_t most = UINT64_MAX >> (64 - 8 * type.bytes + (type.kind == OBJECT_SIGNED ? 1 : 0));
    uint64_t number = 0;
    if (!parse_number(is_negative ? text + 1 : text, &number) ||
        (is_negative && type.kind == OBJECT_UNSIGNED) || number > most + (is_negative ? 1 : 0)) {
        report("%s is not a%s number of %zu byte(s)", text,
               type.kind == OBJECT_SIGNED ? " signed" : "n unsigned", type.bytes);
        return false;
    }
    number = is_negative ? UINT64_C(0) - number : number;
    for (size_t i = 0; i < type.bytes; i++) {
        data[i] = (uint8_t)(number >> (8 * i));
    }
    return true;
}

static bool encode_hex(const char *text, uint8_t *data, size_t size, size_t *length)
{
    size_t digits = 0;
    for (; *text != '\0'; text++) {
        const char *values = "0123456789abcdef", *value;
        if (isspace((unsigned char)*text)) {
            continue;
        }
        value = strchr(values, tolower((unsigned char)*text));
        if (value == NULL || digits / 2 == size) {
            return false;
        }
        unsigned high = digits % 2 == 0 ? 0 : data[digits / 2];
        data[digits / 2] = (uint8_t)(high << 4 | (unsigned)(value - values));
        digits++;
    }
    *length = digits / 2;
    return digits % 2 == 0;
}

bool object_value_encode(object_type_t type, const char *text, uint8_t *data, size_t size,
                         size_t *length)
{
    switch (type.kind) {
    case OBJECT_UNSIGNED:
    case OBJECT_SIGNED:
        *length = type.bytes;
        return encode_number(type, text, data);
    case OBJECT_HEX:
        if (!encode_hex(text, data, size, length)) {
            report("%s is invalid; expected at most %zu bytes in hexadecimal", text, size);
            return false;
        }
        return true;
    default:
        *length = strlen(text);
        if (*length > size) {
            report("the text has more than %zu bytes", size);
            return false;
        }
        memcpy(data, text, *length);
        return true;
    }
}

static uint64_t unsigned_value(const uint8_t *data, size_t length)
{
    uint64_t value = 0;
    while (length-- > 0) {
        value = value << 8 | data[length];
    }
    return value;
}

static int64_t signed_value(const uint8_t *data, size_t length)
{
    uint64_t sign = UINT64_C(1) << (8 * length - 1);
    uint64_t value = unsigned_value(data, length);
    /* Avoids a cast of a number that does not fit. */
    return (value & sign) == 0 ? (int64_t)value : -(int64_t)(sign - 1 - (value ^ sign)) - 1;
}

static void print_hex(const uint8_t *data, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        printf("%s%02X", i > 0 ? " " : "", data[i]);
    }
}

static void print_string(const uint8_t *data, size_t length)
{
    putchar('"');
    for (size_t i = 0; i < length; i++) {
        if (data[i] < ' ' || data[i] > '~' || data[i] == '"' || data[i] == '\\') {
            printf("\\x%02X", data[i]);
        } else {
            putchar(data[i]);
        }
    }
    putchar('"');
}

static void print_any(const uint8_t *data, size_t length)
{
    bool is_text = length > 4;
    for (size_t i = 0; i < length; i++) {
        is_text &= data[i] >= ' ' && data[i] <= '~';
    }
    if (is_text) {
        print_string(data, length);
    } else if (length == 1 || length == 2 || length == 4 || length == 8) {
        uint64_t value = unsigned_value(data, length);
        printf("0x%0*" PRIX64 " (%" PRIu64, (int)(2 * length), value, value);
        if (signed_value(data, length) < 0) {
            printf(", signed %" PRId64, signed_value(data, length));
        }
        printf("), %zu byte(s)", length);
    } else {
        print_hex(data, length);
        printf(" (%zu byte(s))", length);
    }
}

bool object_value_print(object_type_t type, const uint8_t *data, size_t length)
{
    bool is_number = type.kind == OBJECT_UNSIGNED || type.kind == OBJECT_SIGNED;
    bool is_right = !is_number || length == type.bytes;
    if (!is_right) {
        print_hex(data, length);
    } else if (type.kind == OBJECT_UNSIGNED) {
        uint64_t value = unsigned_value(data, length);
        printf("%" PRIu64 " (0x%0*" PRIX64 ")", value, (int)(2 * length), value);
    } else if (type.kind == OBJECT_SIGNED) {
        printf("%" PRId64, signed_value(data, length));
    } else if (type.kind == OBJECT_STRING) {
        print_string(data, length);
    } else if (type.kind == OBJECT_HEX) {
        print_hex(data, length);
    } else {
        print_any(data, length);
    }
    putchar('\n');
    if (!is_right) {
        report("the value has %zu bytes, expected %zu", length, type.bytes);
    }
    return is_right;
}
