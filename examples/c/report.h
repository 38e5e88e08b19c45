/* Error messages on standard error. */
#ifndef REPORT_H
#define REPORT_H

#include <stdarg.h>
#include <stdbool.h>

/* Exit statuses besides EXIT_SUCCESS and EXIT_FAILURE, with the numbers of `ecan`. */
enum {
    EXIT_WRONG_USE = 2,
    EXIT_NO_LIBRARY = 3, /* the EtherCAT master library cannot be loaded */
    EXIT_FILE = 6        /* file or scenario cannot be read, written or parsed */
};

/* Prints an error message, like printf(). */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
void report(const char *format, ...);

/* Prints an error message, like vprintf(). */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 0)))
#endif
void report_list(const char *format, va_list arguments);

/* Prints the error of the last call of the SDK: ecan_last_error(). */
void report_sdk_error(void);

/* Prints a failed operation, its object, and the reason in errno. */
void report_errno(const char *what, const char *object);

/* Marks the reported error as one of a file. */
void report_is_of_file(void);

/* Returns the exit status of the program: that of the first reported error if it is not good. */
int report_exit_status(bool is_good);

#endif /* REPORT_H */
