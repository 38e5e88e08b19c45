#include "report.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "igh_ecan_common.h"

/* EXIT_SUCCESS: no error has a status of its own. */
static int status_of_error = EXIT_SUCCESS;

static void note_status(int status)
{
    if (status_of_error == EXIT_SUCCESS) {
        status_of_error = status;
    }
}

/* Names of files and arguments come from outside: no control character of theirs reaches the terminal. */
static void print_escaped(const char *text)
{
    for (; *text != '\0'; text++) {
        const unsigned char byte = (unsigned char)*text;
        const unsigned char next = (unsigned char)text[1];
        if ((byte < 0x20 && byte != '\n') || byte == 0x7F) {
            fprintf(stderr, "\\x%02x", byte);
        } else if (byte == 0xC2 && next >= 0x80 && next <= 0x9F) { /* C1 in UTF-8 */
            fprintf(stderr, "\\x%02x", next);
            text++;
        } else {
            fputc(byte, stderr);
        }
    }
}

void report_list(const char *format, va_list arguments)
{
    char text[4096];
    /* Keeps the order of both streams, also in one file. */
    fflush(stdout);
    fputs("error: ", stderr);
    vsnprintf(text, sizeof(text), format, arguments);
    print_escaped(text);
    fputc('\n', stderr);
}

void report(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    report_list(format, arguments);
    va_end(arguments);
}

void report_sdk_error(void)
{
    report("%s", ecan_last_error());
    switch (ecan_last_error_code()) {
    case ECAN_ERR_ECRT: note_status(EXIT_NO_LIBRARY); break;
    case ECAN_ERR_FILE: note_status(EXIT_FILE); break;
    default: note_status(EXIT_FAILURE); break;
    }
}

void report_is_of_file(void)
{
    note_status(EXIT_FILE);
}

int report_exit_status(bool is_good)
{
    if (is_good) {
        return EXIT_SUCCESS;
    }
    return status_of_error != EXIT_SUCCESS ? status_of_error : EXIT_FAILURE;
}

void report_errno(const char *what, const char *object)
{
    report("%s %s: %s", what, object, strerror(errno));
}
