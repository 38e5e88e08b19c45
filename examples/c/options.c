#include "options.h"

#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "igh_ecan_common.h"
#include "report.h"

/* Return values of getopt_long(): the index in the list, above all characters. */
enum { FIRST_OPTION = 256 };

void options_wrong_use(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    report_list(format, arguments);
    va_end(arguments);
    fputs("For more information, try --help.\n", stderr);
    exit(EXIT_WRONG_USE);
}

void options_add(option_list_t *list, option_t option)
{
    if (list->count >= OPTIONS_MAX) {
        report("more than %d options", OPTIONS_MAX);
        exit(EXIT_FAILURE);
    }
    list->options[list->count++] = option;
}

bool parse_number(const char *text, uint64_t *number)
{
    bool is_hexadecimal = text[0] == '0' && (text[1] == 'x' || text[1] == 'X');
    const char *digits = is_hexadecimal ? text + 2 : text;
    /* strtoull() also accepts blanks and signs. */
    const char *known = is_hexadecimal ? "0123456789abcdefABCDEF" : "0123456789";
    if (*digits == '\0' || strspn(digits, known) != strlen(digits)) {
        return false;
    }
    errno = 0;
    *number = strtoull(digits, NULL, is_hexadecimal ? 16 : 10);
    return errno == 0;
}

static bool parse_bit_rate(const char *text, uint64_t *rate)
{
    char digits[16];
    size_t length = strlen(text);
    uint64_t factor = 1;
    if (length == 0 || length >= sizeof(digits)) {
        return false;
    }
    switch (text[length - 1]) {
    case 'k': factor = 1000; break;
    case 'M': factor = 1000000; break;
    default: return parse_number(text, rate);
    }
    memcpy(digits, text, length - 1);
    digits[length - 1] = '\0';
    if (strspn(digits, "0123456789") != length - 1 || !parse_number(digits, rate) ||
        *rate > UINT64_MAX / factor) {
        return false;
    }
    *rate *= factor;
    return true;
}

static bool parse_integer(const char *text, int32_t *integer)
{
    bool is_negative = text[0] == '-';
    uint64_t magnitude = 0;
    if (!parse_number(is_negative ? text + 1 : text, &magnitude) ||
        magnitude > (uint64_t)INT32_MAX + (is_negative ? 1 : 0)) {
        return false;
    }
    *integer = (int32_t)(is_negative ? -(int64_t)magnitude : (int64_t)magnitude);
    return true;
}

static void store(const option_t *option, const char *value)
{
    if (option->flag != NULL) {
        *option->flag = true;
    } else if (option->text != NULL) {
        *option->text = value;
    } else if (option->integer != NULL) {
        if (!parse_integer(value, option->integer)) {
            options_wrong_use("--%s %s: expected a number from %" PRId32 " to %" PRId32,
                              option->name, value, INT32_MIN, INT32_MAX);
        }
    } else {
        uint64_t number = 0;
        bool is_number = option->is_bit_rate ? parse_bit_rate(value, &number)
                                             : parse_number(value, &number);
        if (!is_number || number < option->minimum || number > option->maximum) {
            options_wrong_use("--%s %s: expected %s from %" PRIu64 " to %" PRIu64, option->name,
                              value,
                              option->is_bit_rate ? "bit/s (500000, 500k, 1M)" : "a number",
                              option->minimum, option->maximum);
        }
        *option->number = number;
    }
    if (option->is_given != NULL) {
        *option->is_given = true;
    }
}

/* Prints a text after the column of the names, in lines of 80 characters. */
static void print_wrapped(const char *text)
{
    enum { INDENT = 26, WIDTH = 80 };
    size_t column = INDENT;
    for (const char *word = text; *word != '\0';) {
        size_t length = strcspn(word, " ");
        if (column > INDENT && column + 1 + length > WIDTH) {
            printf("\n%*s", INDENT, "");
            column = INDENT;
        } else if (column > INDENT) {
            putchar(' ');
            column++;
        }
        printf("%.*s", (int)length, word);
        column += length;
        word += length;
        word += strspn(word, " ");
    }
    putchar('\n');
}

static void print_option(const option_t *option)
{
    char left[64], text[512];
    size_t room = sizeof(text);
    snprintf(left, sizeof(left), "--%s %s", option->name,
             option->value_name != NULL ? option->value_name : "");
    printf("  %-22s  ", left);
    if (option->is_required) {
        snprintf(text, room, "%s (required)", option->help);
    } else if (option->integer != NULL) {
        snprintf(text, room, "%s [default: %" PRId32 "]", option->help, *option->integer);
    } else if (option->text != NULL && *option->text != NULL) {
        snprintf(text, room, "%s [default: %s]", option->help, *option->text);
    } else if (option->number != NULL && option->is_given == NULL &&
               *option->number >= option->minimum) {
        snprintf(text, room, "%s [default: %" PRIu64 "]", option->help, *option->number);
    } else {
        snprintf(text, room, "%s", option->help);
    }
    print_wrapped(text);
}

static void print_help(const option_list_t *list, const char *program)
{
    const option_t help = {.name = "help", .help = "Print this"};
    const option_t version = {.name = "version", .help = "Print the version"};
    printf("%s\n\nUsage: %s [OPTIONS]\n\nOptions:\n", list->about, program);
    for (size_t i = 0; i < list->count; i++) {
        print_option(&list->options[i]);
    }
    print_option(&help);
    print_option(&version);
    printf("\nExit status:\n  0  success\n  %d  the run failed\n  %d  invalid arguments\n"
           "  %d  the EtherCAT master library cannot be loaded\n"
           "  %d  file or scenario cannot be read, written or parsed\n",
           EXIT_FAILURE, EXIT_WRONG_USE, EXIT_NO_LIBRARY, EXIT_FILE);
}

/* Returns true if the command line contains the option. */
static bool has_value(const option_list_t *list, const char *const *values, const char *name)
{
    for (size_t i = 0; i < list->count; i++) {
        if (strcmp(list->options[i].name, name) == 0) {
            return values[i] != NULL;
        }
    }
    return false;
}

void options_parse(const option_list_t *list, int argc, char **argv)
{
    enum { HELP = 1, VERSION = 2 };
    struct option table[OPTIONS_MAX + 3];
    /* Values are stored at the end, so that the help shows the defaults. */
    const char *values[OPTIONS_MAX] = {NULL};
    memset(table, 0, sizeof(table));
    for (size_t i = 0; i < list->count; i++) {
        table[i].name = list->options[i].name;
        table[i].has_arg = list->options[i].flag != NULL ? no_argument : required_argument;
        table[i].val = FIRST_OPTION + (int)i;
    }
    table[list->count] = (struct option){"help", no_argument, NULL, HELP};
    table[list->count + 1] = (struct option){"version", no_argument, NULL, VERSION};

    /* With the colon getopt returns ':' for a missing value and prints no message. */
    int found;
    while ((found = getopt_long(argc, argv, ":h", table, NULL)) != -1) {
        switch (found) {
        case 'h':
        case HELP:
            print_help(list, argv[0]);
            exit(EXIT_SUCCESS);
        case VERSION:
            printf("%s %s\n", argv[0], ecan_version_text());
            exit(EXIT_SUCCESS);
        case ':':
            options_wrong_use("%s needs a value", argv[optind - 1]);
        case '?':
            options_wrong_use("%s is not an option, or has no value", argv[optind - 1]);
        default:
            values[found - FIRST_OPTION] = optarg != NULL ? optarg : "";
        }
    }
    if (optind < argc) {
        options_wrong_use("%s is not an option", argv[optind]);
    }
    for (size_t i = 0; i < list->count; i++) {
        const char *other = list->options[i].excluded_by;
        if (values[i] != NULL && other != NULL && has_value(list, values, other)) {
            options_wrong_use("--%s and --%s exclude each other", list->options[i].name, other);
        }
        if (values[i] != NULL) {
            store(&list->options[i], values[i]);
        } else if (list->options[i].is_required) {
            options_wrong_use("--%s %s is missing", list->options[i].name,
                              list->options[i].value_name);
        }
    }
}
