/* Counted checks, and contexts that every function must reject. */
#ifndef CHECK_H
#define CHECK_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "igh_adapter.h"
#include "igh_canopen.h"
#include "igh_cia402_protocol.h"
#include "igh_mcan_port.h"
#include "igh_observer.h"
#include "igh_plan.h"
#include "igh_real_time.h"
#include "igh_sim.h"

/* A call that succeeds and does not change the last error. */
#define GOOD(call)                                                                                 \
    do {                                                                                           \
        check_before();                                                                            \
        check_good(__FILE__, __LINE__, #call, (call));                                             \
    } while (0)

/* A call that returns this code, with a text. */
#define BAD(code, call)                                                                            \
    do {                                                                                           \
        check_before();                                                                            \
        check_bad(__FILE__, __LINE__, #call, (code), (call));                                      \
    } while (0)

/* A getter that returns this value and fails with this code. */
#define NONE(code, value, call)                                                                    \
    do {                                                                                           \
        check_before();                                                                            \
        check_none(__FILE__, __LINE__, #call, (code), (long long)(value), (long long)(call));      \
    } while (0)

/* A value of any integer type. */
#define SAME(value, expression)                                                                    \
    check_same(__FILE__, __LINE__, #expression, (long long)(value), (long long)(expression))

#define TRUE(condition) check_true(__FILE__, __LINE__, #condition, (condition))

/* Checks for a part of the text of the last error, or of another text. */
#define ERROR_HAS(part) check_text(__FILE__, __LINE__, (part), ecan_last_error())
#define TEXT_HAS(part, text) check_text(__FILE__, __LINE__, (part), (text))

#define ITEMS(array) (sizeof(array) / sizeof((array)[0]))

void check_before(void);
void check_good(const char *file, int line, const char *call, int found);
void check_bad(const char *file, int line, const char *call, int expected, int found);
void check_none(const char *file, int line, const char *call, int code, long long expected,
                long long found);
void check_same(const char *file, int line, const char *what, long long expected,
                long long found);
void check_true(const char *file, int line, const char *what, int condition);
void check_text(const char *file, int line, const char *part, const char *text);

/* Description of the tested case, for failures; NULL for none. */
void check_about(const char *about);
unsigned long check_count(void);
unsigned long check_failures(void);

/* Fills memory with any content: 0x00, 0xFF, 0xA5, and random bytes. */
#define GARBAGE_KINDS 4
const char *fill_garbage(int kind, void *memory, size_t size);

/* Creates a file in an own directory and stores its path. Returns 0 for success. */
int write_file(const char *text, char *path, size_t size);
void remove_file(const char *path);

/* Creates a scenario file; `setting` gets "sim:" and its path. Returns 0 for success. */
int write_scenario(const char *toml, char *setting, size_t size);
void remove_scenario(const char *setting);

/* Configurations for a simulated bus with a stepped clock. */
void simulate(ecan_igh_config_t *config, const char *setting);
/* Channel 0 of the first gateway has classic CAN. */
void simulate_channel(ecan_igh_config_t *igh_config, igh_mcan_port_config_t *config,
                      const char *setting, uint32_t bitrate);
/* Initialises a context, and a Port whose configuration is applied, or fails. */
int start_port(ecan_igh_context_t *igh, igh_mcan_port_t *port, const ecan_igh_config_t *igh_config,
               const igh_mcan_port_config_t *config);

/* Begins a cycle with axes, up to their targets. */
void begin_axes(igh_mcan_port_t *port, igh_cia402_context_t *motors);
/* Cycles in which all axes get their targets. */
void run_axes(igh_mcan_port_t *port, igh_cia402_context_t *motors, int cycles);
/* Value of an object of a drive. */
long axis_object(igh_cia402_context_t *motors, size_t axis, uint16_t index, uint8_t subindex);

/* The tests, by header. */
void test_common(void);
void test_pdo(void);
void test_pdo_parse(void);
void test_adapter_config(void);
void test_adapter_life(void);
void test_adapter_cycle(void);
void test_adapter_real_time(void);
void test_adapter_sdo(void);
void test_port_config(void);
void test_config_file(void);
void test_config_file_run(void);
void test_port_life(void);
void test_port_service(void);
void test_port_cycle(void);
void test_port_schedule(void);
void test_cia402_axes(void);
void test_cia402_motion(void);
void test_cia402_sdo(void);
void test_cia402_further(void);
void test_cia402_node_axes(void);
void test_canopen_life(void);
void test_canopen_network(void);
void test_canopen_lss(void);
void test_plan(void);
void test_stop(void);
void test_reserved(void);
void test_observer(void);
void test_null_pointers(void);

#endif
