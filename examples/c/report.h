/* One readable message on standard error for whatever ends a program. */
#ifndef REPORT_H
#define REPORT_H

/* How the programs end; wrong use is told apart from a run that failed. */
enum { EXIT_WRONG_USE = 2 };

/* Says what went wrong, as printf() does. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
void report(const char *format, ...);

/* Says what the SDK found wrong in the last call: ecan_last_error(). */
void report_sdk_error(void);

/* Says what could not be done to what and, from errno, why. */
void report_errno(const char *what, const char *object);

#endif /* REPORT_H */
