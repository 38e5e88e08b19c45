/* Error messages on standard error. */
#ifndef REPORT_H
#define REPORT_H

/* Exit statuses; wrong use has its own. */
enum { EXIT_WRONG_USE = 2 };

/* Prints an error message, like printf(). */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
void report(const char *format, ...);

/* Prints the error of the last call of the SDK: ecan_last_error(). */
void report_sdk_error(void);

/* Prints a failed operation, its object, and the reason in errno. */
void report_errno(const char *what, const char *object);

#endif /* REPORT_H */
