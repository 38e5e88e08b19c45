/* Values of CANopen objects as text. */
#ifndef OBJECT_VALUE_H
#define OBJECT_VALUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum {
    OBJECT_ANY, /* unknown: shown in every format that fits */
    OBJECT_UNSIGNED,
    OBJECT_SIGNED,
    OBJECT_STRING,
    OBJECT_HEX,
} object_kind_t;

typedef struct {
    object_kind_t kind;
    size_t bytes; /* of a number */
} object_type_t;

/* u8, u16, u32, u64, i8, i16, i32, i64, string or hex; false for other names. */
bool object_type_parse(const char *name, object_type_t *type);

/* Converts a text to the bytes of a value, little-endian. Returns false, with a message on
 * standard error, if the text is not a value of the type. */
bool object_value_encode(object_type_t type, const char *text, uint8_t *data, size_t size,
                         size_t *length);

/* Prints a value and a line break. Returns false, with a message on standard error, if the
 * length is not that of the type. */
bool object_value_print(object_type_t type, const uint8_t *data, size_t length);

#endif /* OBJECT_VALUE_H */
