/* igh_ecan_common.h */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <pthread.h>

static const struct {
    int code;
    const char *name;
} CODES[] = {
    {ECAN_OK, "ECAN_OK"},
    {ECAN_ERR_NULL, "ECAN_ERR_NULL"},
    {ECAN_ERR_ARGUMENT, "ECAN_ERR_ARGUMENT"},
    {ECAN_ERR_NOT_INITIALISED, "ECAN_ERR_NOT_INITIALISED"},
    {ECAN_ERR_ORDER, "ECAN_ERR_ORDER"},
    {ECAN_ERR_BUSY, "ECAN_ERR_BUSY"},
    {ECAN_ERR_BUFFER, "ECAN_ERR_BUFFER"},
    {ECAN_ERR_FULL, "ECAN_ERR_FULL"},
    {ECAN_ERR_CONFIG, "ECAN_ERR_CONFIG"},
    {ECAN_ERR_SLAVE, "ECAN_ERR_SLAVE"},
    {ECAN_ERR_CHANNEL, "ECAN_ERR_CHANNEL"},
    {ECAN_ERR_FRAME, "ECAN_ERR_FRAME"},
    {ECAN_ERR_NOT_FD, "ECAN_ERR_NOT_FD"},
    {ECAN_ERR_SCHEDULE, "ECAN_ERR_SCHEDULE"},
    {ECAN_ERR_NO_ROOM, "ECAN_ERR_NO_ROOM"},
    {ECAN_ERR_QUEUE_FULL, "ECAN_ERR_QUEUE_FULL"},
    {ECAN_ERR_BUS_OFF, "ECAN_ERR_BUS_OFF"},
    {ECAN_ERR_NOT_READY, "ECAN_ERR_NOT_READY"},
    {ECAN_ERR_IMAGE_BUSY, "ECAN_ERR_IMAGE_BUSY"},
    {ECAN_ERR_PARSE, "ECAN_ERR_PARSE"},
    {ECAN_ERR_ECRT, "ECAN_ERR_ECRT"},
    {ECAN_ERR_MASTER, "ECAN_ERR_MASTER"},
    {ECAN_ERR_NOT_FOUND, "ECAN_ERR_NOT_FOUND"},
    {ECAN_ERR_IDENTITY, "ECAN_ERR_IDENTITY"},
    {ECAN_ERR_SDO, "ECAN_ERR_SDO"},
    {ECAN_ERR_READBACK, "ECAN_ERR_READBACK"},
    {ECAN_ERR_TIMEOUT, "ECAN_ERR_TIMEOUT"},
    {ECAN_ERR_NOT_OPERATIONAL, "ECAN_ERR_NOT_OPERATIONAL"},
    {ECAN_ERR_VERIFICATION, "ECAN_ERR_VERIFICATION"},
    {ECAN_ERR_ATTACHED, "ECAN_ERR_ATTACHED"},
    {ECAN_ERR_AXIS, "ECAN_ERR_AXIS"},
    {ECAN_ERR_AXIS_STATE, "ECAN_ERR_AXIS_STATE"},
    {ECAN_ERR_AXES, "ECAN_ERR_AXES"},
    {ECAN_ERR_CANOPEN, "ECAN_ERR_CANOPEN"},
    {ECAN_ERR_STOPPED, "ECAN_ERR_STOPPED"},
    {ECAN_ERR_PRIVILEGE, "ECAN_ERR_PRIVILEGE"},
    {ECAN_ERR_FILE, "ECAN_ERR_FILE"},
    {ECAN_ERR_LAYOUT, "ECAN_ERR_LAYOUT"},
    {ECAN_ERR_NODE, "ECAN_ERR_NODE"},
    {ECAN_ERR_BOOT, "ECAN_ERR_BOOT"},
    {ECAN_ERR_INTERNAL, "ECAN_ERR_INTERNAL"},
};

static void codes(void)
{
    static const int NO_CODES[] = {1, 100, -40, -98, -100, INT32_MAX, INT32_MIN};
    for (size_t i = 0; i < ITEMS(CODES); i++) {
        TRUE(strcmp(ecan_result_name(CODES[i].code), CODES[i].name) == 0);
        TRUE(ecan_result_text(CODES[i].code)[0] != '\0');
        SAME(CODES[i].code <= ECAN_ERR_NO_ROOM && CODES[i].code >= ECAN_ERR_NOT_READY,
             ecan_result_is_temporary(CODES[i].code));
        for (size_t other = 0; other < i; other++) {
            TRUE(strcmp(ecan_result_text(CODES[i].code), ecan_result_text(CODES[other].code)) !=
                 0);
        }
    }
    for (size_t i = 0; i < ITEMS(NO_CODES); i++) {
        TRUE(strcmp(ecan_result_name(NO_CODES[i]), "unknown result") == 0);
        TRUE(ecan_result_text(NO_CODES[i])[0] != '\0');
        SAME(0, ecan_result_is_temporary(NO_CODES[i]));
    }
    TRUE(strcmp(ecan_result_text(ECAN_ERR_MASTER), "a call of the EtherCAT master failed") == 0);
}

struct other_thread {
    int is_empty_at_first;
    int code_at_first;
    int code;
};

static void *another_thread(void *user)
{
    struct other_thread *seen = user;
    seen->is_empty_at_first = ecan_last_error()[0] == '\0';
    seen->code_at_first = ecan_last_error_code();
    igh_mcan_len_from_dlc(16, 0);
    seen->code = ecan_last_error_code();
    return NULL;
}

static void last_error(void)
{
    struct other_thread seen = {0, 1, 0};
    pthread_t thread;

    TRUE(strcmp(ecan_last_error(), "") == 0);
    SAME(0, ecan_last_error_code());
    SAME(0, ecan_last_abort_code());

    SAME(ECAN_ERR_NULL, ecan_igh_default_config(NULL));
    SAME(ECAN_ERR_NULL, ecan_last_error_code());
    ERROR_HAS("ecan_igh_default_config: ");
    SAME(0, ecan_last_abort_code());

    /* Success does not change it. */
    SAME(8, igh_mcan_len_from_dlc(8, 0));
    SAME(ECAN_ERR_NULL, ecan_last_error_code());

    /* It belongs to this thread. */
    SAME(0, pthread_create(&thread, NULL, another_thread, &seen));
    SAME(0, pthread_join(thread, NULL));
    SAME(1, seen.is_empty_at_first);
    SAME(0, seen.code_at_first);
    SAME(ECAN_ERR_ARGUMENT, seen.code);
    SAME(ECAN_ERR_NULL, ecan_last_error_code());

    ecan_clear_last_error();
    TRUE(strcmp(ecan_last_error(), "") == 0);
    SAME(0, ecan_last_error_code());
    SAME(0, ecan_last_abort_code());
    ecan_clear_last_error();
    SAME(0, ecan_last_error_code());
}

void test_common(void)
{
    char version[32];
    last_error();
    codes();
    SAME(ECAN_VERSION, ecan_version());
    snprintf(version, sizeof(version), "%d.%d.%d", ECAN_VERSION_MAJOR, ECAN_VERSION_MINOR,
             ECAN_VERSION_PATCH);
    TRUE(strcmp(ecan_version_text(), version) == 0);
}
