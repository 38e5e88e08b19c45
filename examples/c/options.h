/* Command line options for getopt_long(), with their help. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { OPTIONS_MAX = 32 };

/* One option. Exactly one of flag, number, integer and text is set, and determines its kind. The
 * previous value there is the default; a number below the minimum is no default. */
typedef struct {
    const char *name;       /* without the dashes */
    const char *value_name; /* name of the value in the help; not for a flag */
    bool *flag;             /* a switch without a value */
    int32_t *integer;       /* a number that may be negative */
    const char **text;
    uint64_t *number;       /* a number from minimum to maximum */
    uint64_t minimum, maximum;
    bool is_bit_rate;       /* the number may end in k or M, for thousands and millions */
    bool *is_given;         /* may be NULL; gets true if the option is given */
    bool is_required;
    const char *excluded_by; /* option that excludes this one; may be NULL */
    const char *help;
} option_t;

typedef struct {
    const char *about; /* sentence for the help */
    option_t options[OPTIONS_MAX];
    size_t count;
} option_list_t;

/* Appends an option; one that does not fit ends the program. */
void options_add(option_list_t *list, option_t option);

/* Parses the command line. Does not return from --help, --version and wrong use, which prints a
 * message and ends with status 2. */
void options_parse(const option_list_t *list, int argc, char **argv);

/* Ends the program like options_parse(), for errors that it does not detect. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2), noreturn))
#endif
void options_wrong_use(const char *format, ...);

/* Parses a number, decimal or hexadecimal with 0x, up to the end of the text. */
bool parse_number(const char *text, uint64_t *number);

#endif /* OPTIONS_H */
