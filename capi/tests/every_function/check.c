#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <stdlib.h>
#include <unistd.h>

static unsigned long checks;
static unsigned long failures;
static const char *what_about;

static void failed(const char *file, int line, const char *what)
{
    const char *name = strrchr(file, '/');
    failures++;
    fprintf(stderr, "%s:%d: %s%s%s%s\n", name == NULL ? file : name + 1, line, what,
            what_about == NULL ? "" : " [", what_about == NULL ? "" : what_about,
            what_about == NULL ? "" : "]");
}

/* The text of the last error begins with the called function. */
static int names_function(const char *call)
{
    size_t length = strcspn(call, "(");
    const char *text = ecan_last_error();
    return strncmp(text, call, length) == 0 && strncmp(text + length, ": ", 2) == 0 &&
           text[length + 2] != '\0';
}

void check_before(void)
{
    ecan_clear_last_error();
}

void check_good(const char *file, int line, const char *call, int found)
{
    checks++;
    if (found != ECAN_OK) {
        failed(file, line, call);
        fprintf(stderr, "    expected ECAN_OK, found %s: %s\n", ecan_result_name(found),
                ecan_last_error());
    } else if (ecan_last_error()[0] != '\0' || ecan_last_error_code() != 0) {
        failed(file, line, call);
        fprintf(stderr, "    succeeded, but left an error: %s\n", ecan_last_error());
    }
}

void check_bad(const char *file, int line, const char *call, int expected, int found)
{
    check_none(file, line, call, expected, expected, found);
}

void check_none(const char *file, int line, const char *call, int code, long long expected,
                long long found)
{
    checks++;
    if (found != expected) {
        failed(file, line, call);
        fprintf(stderr, "    expected %lld (%s), found %lld (%s): %s\n", expected,
                ecan_result_name((int)expected), found, ecan_result_name((int)found),
                ecan_last_error());
    } else if (ecan_last_error_code() != code) {
        failed(file, line, call);
        fprintf(stderr, "    expected the last error %s, found %s: %s\n", ecan_result_name(code),
                ecan_result_name(ecan_last_error_code()), ecan_last_error());
    } else if (!names_function(call)) {
        failed(file, line, call);
        fprintf(stderr, "    the text does not name the function: \"%s\"\n", ecan_last_error());
    }
}

void check_same(const char *file, int line, const char *what, long long expected, long long found)
{
    checks++;
    if (found != expected) {
        failed(file, line, what);
        fprintf(stderr, "    expected %lld, found %lld; last error: %s\n", expected, found,
                ecan_last_error());
    }
}

void check_true(const char *file, int line, const char *what, int condition)
{
    checks++;
    if (!condition) {
        failed(file, line, what);
        fprintf(stderr, "    is not so; last error: %s\n", ecan_last_error());
    }
}

void check_text(const char *file, int line, const char *part, const char *text)
{
    checks++;
    if (strstr(text, part) == NULL) {
        failed(file, line, part);
        fprintf(stderr, "    is not in: \"%s\"\n", text);
    }
}

void check_about(const char *about)
{
    what_about = about;
}

unsigned long check_count(void)
{
    return checks;
}

unsigned long check_failures(void)
{
    return failures;
}

const char *fill_garbage(int kind, void *memory, size_t size)
{
    static uint64_t random = 0x9E3779B97F4A7C15u;
    unsigned char *bytes = memory;
    switch (kind) {
    case 0:
        memset(memory, 0x00, size);
        return "memory of 0x00";
    case 1:
        memset(memory, 0xFF, size);
        return "memory of 0xFF";
    case 2:
        memset(memory, 0xA5, size);
        return "memory of 0xA5";
    default:
        for (size_t i = 0; i < size; i++) {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            bytes[i] = (unsigned char)random;
        }
        return "random memory";
    }
}

/* In an own directory that is deleted with it. */
int write_file(const char *text, char *path, size_t size)
{
    const char *parent = getenv("TMPDIR");
    char directory[256];
    FILE *file;
    int length = snprintf(directory, sizeof(directory), "%s/every_function_XXXXXX",
                          parent == NULL ? "/tmp" : parent);
    if (length >= (int)sizeof(directory) || mkdtemp(directory) == NULL ||
        snprintf(path, size, "%s/file.toml", directory) >= (int)size) {
        return -1;
    }
    file = fopen(path, "w");
    if (file == NULL) {
        return -1;
    }
    length = fputs(text, file);
    return fclose(file) == 0 && length >= 0 ? 0 : -1;
}

void remove_file(const char *path)
{
    char directory[512];
    snprintf(directory, sizeof(directory), "%s", path);
    unlink(directory);
    *strrchr(directory, '/') = '\0';
    rmdir(directory);
}

int write_scenario(const char *toml, char *setting, size_t size)
{
    const size_t prefix = strlen("sim:");
    if (size <= prefix) {
        return -1;
    }
    memcpy(setting, "sim:", prefix);
    return write_file(toml, setting + prefix, size - prefix);
}

void remove_scenario(const char *setting)
{
    remove_file(setting + strlen("sim:"));
}

void simulate(ecan_igh_config_t *config, const char *setting)
{
    GOOD(ecan_igh_default_config(config));
    GOOD(ecan_igh_config_set_ecrt(config, setting));
    GOOD(ecan_igh_config_set_stepped_clock(config, 1));
    GOOD(ecan_igh_config_set_cycle_us(config, 1000));
}

void simulate_channel(ecan_igh_config_t *igh_config, igh_mcan_port_config_t *config,
                      const char *setting, uint32_t bitrate)
{
    simulate(igh_config, setting);
    GOOD(igh_mcan_port_default_config(config));
    GOOD(igh_mcan_port_set_classic_channel(config, 0, 0, bitrate));
}

int start_port(ecan_igh_context_t *igh, igh_mcan_port_t *port, const ecan_igh_config_t *igh_config,
               const igh_mcan_port_config_t *config)
{
    static ecan_igh_config_t applied;
    applied = *igh_config;
    GOOD(igh_mcan_port_apply_config(&applied, config));
    GOOD(ecan_igh_init(igh, &applied));
    GOOD(igh_mcan_port_init(port, igh, config));
    GOOD(ecan_igh_wait_op_timeout(igh, 20000));
    return igh_mcan_port_is_ready(port) ? 0 : -1;
}

void begin_axes(igh_mcan_port_t *port, igh_cia402_context_t *motors)
{
    GOOD(igh_mcan_port_wait_next_cycle(port));
    GOOD(igh_mcan_port_cycle_begin(port));
    GOOD(igh_cia402_process_rx(motors));
}

void run_axes(igh_mcan_port_t *port, igh_cia402_context_t *motors, int cycles)
{
    for (int i = 0; i < cycles; i++) {
        begin_axes(port, motors);
        GOOD(igh_cia402_send_targets_all(motors));
        GOOD(igh_mcan_port_cycle_end(port));
    }
}

long axis_object(igh_cia402_context_t *motors, size_t axis, uint16_t index, uint8_t subindex)
{
    uint8_t data[4] = {0};
    size_t length;
    GOOD(igh_cia402_sdo_upload(motors, axis, index, subindex, data, sizeof(data), &length, 2000));
    return (long)data[0] | (long)data[1] << 8 | (long)data[2] << 16 | (long)data[3] << 24;
}
