/* Command line options: a list of them, made known to getopt_long(), and their help. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { OPTIONS_MAX = 32 };

/* One option. Where its value goes says of what kind it is: exactly one of flag, number, integer
 * and text is set. What stands there before is the default; one below the minimum says "none". */
typedef struct {
    const char *name;       /* without the dashes */
    const char *value_name; /* as the help calls the value; not for a flag */
    const char *help;
    bool *flag;             /* a switch without a value */
    uint64_t *number;       /* a number from minimum to maximum */
    uint64_t minimum, maximum;
    int32_t *integer;       /* a number that may be negative */
    const char **text;
    bool *is_given;         /* may be NULL; gets true where the option was given */
    bool is_required;
    const char *excluded_by; /* the option that this one cannot be given with; may be NULL */
} option_t;

typedef struct {
    const char *about; /* one sentence for the help */
    option_t options[OPTIONS_MAX];
    size_t count;
} option_list_t;

/* Appends an option; one that does not fit ends the program. */
void options_add(option_list_t *list, option_t option);

/* Takes the command line. Does not come back from --help and --version, nor from wrong use, which
 * gets a message and the exit status 2. */
void options_parse(const option_list_t *list, int argc, char **argv);

/* Ends the program like options_parse() for something that it cannot know: options that exclude
 * each other, for example. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2), noreturn))
#endif
void options_wrong_use(const char *format, ...);

/* A number, decimal or hexadecimal with 0x, with nothing behind it. */
bool parse_number(const char *text, uint64_t *number);

#endif /* OPTIONS_H */
