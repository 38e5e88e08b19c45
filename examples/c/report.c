#include "report.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "igh_ecan_common.h"

void report(const char *format, ...)
{
    va_list arguments;
    /* Keeps the order of both streams, also in one file. */
    fflush(stdout);
    fputs("error: ", stderr);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}

void report_sdk_error(void)
{
    report("%s", ecan_last_error());
}

void report_errno(const char *what, const char *object)
{
    report("%s %s: %s", what, object, strerror(errno));
}
