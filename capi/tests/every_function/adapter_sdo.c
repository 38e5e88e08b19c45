/* igh_adapter.h: SDO transfers that wait, requests in the cycle, diagnosis from another thread. */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <pthread.h>

#define CYCLES 5000
#define ABORT_NO_OBJECT 0x06020000
#define ABORT_READ_ONLY 0x06010002
#define ABORT_NO_SUBINDEX 0x06090011

static const uint8_t ZERO[8];

static void waiting_transfers(ecan_igh_context_t *context)
{
    uint8_t data[64];
    size_t length = 99;

    fill_garbage(2, data, sizeof(data));
    GOOD(ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, sizeof(data), &length));
    SAME(4, length);
    SAME(0xA5, data[4]);
    GOOD(ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, 4, &length));
    SAME(4, length);
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, 3, &length));
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, 1, &length));
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, 0, &length));
    BAD(ECAN_ERR_SDO, ecan_igh_sdo_upload(context, 0, 0x5555, 0, data, 64, &length));
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());
    ERROR_HAS("0x5555");
    BAD(ECAN_ERR_SDO, ecan_igh_sdo_upload(context, 0, 0x1018, 99, data, 64, &length));
    SAME(ABORT_NO_SUBINDEX, ecan_last_abort_code());
    BAD(ECAN_ERR_SDO, ecan_igh_sdo_download(context, 0, 0x1018, 1, ZERO, 4));
    SAME(ABORT_READ_ONLY, ecan_last_abort_code());
    BAD(ECAN_ERR_SDO, ecan_igh_sdo_download(context, 0, 0x5555, 0, ZERO, 4));
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());
    /* An error without an SDO abort has no abort code. */
    BAD(ECAN_ERR_SLAVE, ecan_igh_sdo_download(context, 7, 0x5555, 0, ZERO, 4));
    SAME(0, ecan_last_abort_code());
    GOOD(ecan_igh_sdo_upload(context, 0, 0x8001, 36, data, sizeof(data), &length));
    GOOD(ecan_igh_sdo_download(context, 0, 0x8001, 36, data, length));
}

static void cycle(ecan_igh_context_t *context)
{
    ecan_igh_wait_next_cycle(context);
    ecan_igh_receive(context);
    ecan_igh_send(context);
}

/* Runs the cycle until the request is done. */
static int finish(ecan_igh_context_t *context, size_t request)
{
    int state = ECAN_IGH_REQUEST_RUNNING;
    for (int i = 0; i < CYCLES && state == ECAN_IGH_REQUEST_RUNNING; i++) {
        cycle(context);
        state = ecan_igh_sdo_request_state(context, request);
    }
    return state;
}

static void wrong_request(ecan_igh_context_t *context, size_t request)
{
    uint8_t data[8];
    size_t length;
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_timeout(context, request, 100));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_read(context, request, 0x1018, 1));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_write(context, request, 0x1018, 1, ZERO, 4));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_state(context, request));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_data(context, request, data, 8, &length));
}

static void create_requests(ecan_igh_context_t *context, size_t *request, size_t *small)
{
    size_t large;
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_create_sdo_request(context, 0, 0, request));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_create_sdo_request(context, 0, SIZE_MAX, request));
    wrong_request(context, 0);
    GOOD(ecan_igh_create_sdo_request(context, 0, 64, request));
    GOOD(ecan_igh_create_sdo_request(context, 0, 1, small));
    GOOD(ecan_igh_create_sdo_request(context, 0, 65536, &large));
    TRUE(*request != *small && *small != large && *request != large);
    SAME(ECAN_IGH_REQUEST_UNUSED, ecan_igh_sdo_request_state(context, *request));
    GOOD(ecan_igh_sdo_request_timeout(context, *request, 0));
    GOOD(ecan_igh_sdo_request_timeout(context, *request, 2000));
}

static void use_requests(ecan_igh_context_t *context, size_t request, size_t small)
{
    uint8_t blocking[64];
    uint8_t data[64];
    size_t blocking_length = 0;
    size_t length = 99;

    wrong_request(context, 3);
    wrong_request(context, SIZE_MAX);
    BAD(ECAN_ERR_ORDER, ecan_igh_sdo_request_data(context, request, data, 64, &length));
    GOOD(ecan_igh_sdo_request_read(context, request, 0x1018, 2));
    BAD(ECAN_ERR_ORDER, ecan_igh_sdo_request_read(context, request, 0x1018, 2));
    BAD(ECAN_ERR_ORDER, ecan_igh_sdo_request_write(context, request, 0x1018, 2, ZERO, 4));
    BAD(ECAN_ERR_ORDER, ecan_igh_sdo_request_data(context, request, data, 64, &length));
    SAME(ECAN_IGH_REQUEST_RUNNING, ecan_igh_sdo_request_state(context, request));
    SAME(ECAN_IGH_REQUEST_SUCCESS, finish(context, request));
    fill_garbage(2, data, sizeof(data));
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_request_data(context, request, data, 0, &length));
    SAME(0xA5, data[0]);
    GOOD(ecan_igh_sdo_upload(context, 0, 0x1018, 2, blocking, sizeof(blocking),
                             &blocking_length));
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_request_data(context, request, data, 3, &length));
    SAME(4, length);
    SAME(0, memcmp(data, blocking, 3));
    SAME(0xA5, data[3]);
    GOOD(ecan_igh_sdo_request_data(context, request, data, 4, &length));
    SAME(4, length);
    SAME(0, memcmp(data, blocking, 4));

    GOOD(ecan_igh_sdo_request_read(context, request, 0x5555, 0));
    SAME(ECAN_IGH_REQUEST_ERROR, finish(context, request));
    BAD(ECAN_ERR_ORDER, ecan_igh_sdo_request_data(context, request, data, 64, &length));
    GOOD(ecan_igh_sdo_request_write(context, request, 0x1018, 1, ZERO, 4));
    SAME(ECAN_IGH_REQUEST_ERROR, finish(context, request));
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_request_write(context, small, 0x8001, 36, ZERO, 2));
    GOOD(ecan_igh_sdo_upload(context, 0, 0x8001, 36, blocking, sizeof(blocking),
                             &blocking_length));
    SAME(1, blocking_length);
    BAD(ECAN_ERR_BUFFER, ecan_igh_sdo_request_write(context, request, 0x8001, 36, blocking, 1));
    GOOD(ecan_igh_sdo_request_write(context, small, 0x8001, 36, blocking, 1));
    SAME(ECAN_IGH_REQUEST_SUCCESS, finish(context, small));
}

static void no_diagnostics(int code, ecan_igh_diagnostics_t *handle)
{
    ecan_igh_master_state_t state;
    uint8_t data[8];
    size_t length;
    BAD(code, ecan_igh_diagnostics_sdo_upload(handle, 0, 0x1018, 1, data, 8, &length));
    BAD(code, ecan_igh_diagnostics_sdo_download(handle, 0, 0x1018, 1, ZERO, 4));
    BAD(code, ecan_igh_diagnostics_master_state(handle, &state));
    if (handle == NULL) {
        BAD(code, ecan_igh_diagnostics_deinit(handle));
    } else {
        GOOD(ecan_igh_diagnostics_deinit(handle));
    }
}

static void handles(ecan_igh_context_t *context)
{
    ecan_igh_diagnostics_t handle;
    ecan_igh_diagnostics_t copy;
    ecan_igh_master_state_t state;
    uint8_t data[8];
    size_t length = 99;

    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &handle, sizeof(handle)));
        no_diagnostics(ECAN_ERR_NOT_INITIALISED, &handle);
        GOOD(ecan_igh_diagnostics_open(&handle, context));
        BAD(ECAN_ERR_ORDER, ecan_igh_diagnostics_open(&handle, context));
        copy = handle;
        check_about("a copy");
        no_diagnostics(ECAN_ERR_NOT_INITIALISED, &copy);
        GOOD(ecan_igh_diagnostics_master_state(&handle, &state));
        GOOD(ecan_igh_diagnostics_deinit(&handle));
        check_about("a handle that is closed");
        no_diagnostics(ECAN_ERR_NOT_INITIALISED, &handle);
    }
    check_about("a context");
    no_diagnostics(ECAN_ERR_NOT_INITIALISED, (ecan_igh_diagnostics_t *)(void *)context);
    check_about(NULL);

    GOOD(ecan_igh_diagnostics_open(&handle, context));
    BAD(ECAN_ERR_SLAVE, ecan_igh_diagnostics_sdo_upload(&handle, 1, 0x1018, 1, data, 8, &length));
    BAD(ECAN_ERR_SLAVE, ecan_igh_diagnostics_sdo_download(&handle, SIZE_MAX, 0x1018, 1, ZERO, 4));
    GOOD(ecan_igh_diagnostics_sdo_upload(&handle, 0, 0x1018, 1, data, 8, &length));
    SAME(4, length);
    BAD(ECAN_ERR_SDO, ecan_igh_diagnostics_sdo_download(&handle, 0, 0x1018, 1, ZERO, 4));
    SAME(ABORT_READ_ONLY, ecan_last_abort_code());
    GOOD(ecan_igh_diagnostics_deinit(&handle));
    GOOD(ecan_igh_diagnostics_deinit(&handle));
}

/* Results of another thread; until it is joined only that thread writes, except `is_done`. */
struct worker {
    pthread_mutex_t lock;
    int is_done;
    ecan_igh_diagnostics_t handle;
    int upload;
    int rejected;
    uint32_t abort_code;
    int download;
    int state;
    size_t length;
    uint8_t data[8];
    ecan_igh_master_state_t master;
};

static void *run_worker(void *user)
{
    struct worker *worker = user;
    ecan_igh_diagnostics_t *handle = &worker->handle;
    worker->upload = ecan_igh_diagnostics_sdo_upload(handle, 0, 0x1018, 1, worker->data,
                                                     sizeof(worker->data), &worker->length);
    worker->rejected = ecan_igh_diagnostics_sdo_upload(
        handle, 0, 0x5555, 0, worker->data, sizeof(worker->data), &worker->length);
    worker->abort_code = ecan_last_abort_code();
    worker->download = ecan_igh_diagnostics_sdo_download(handle, 0, 0x1018, 1, ZERO, 4);
    worker->state = ecan_igh_diagnostics_master_state(handle, &worker->master);
    pthread_mutex_lock(&worker->lock);
    worker->is_done = 1;
    pthread_mutex_unlock(&worker->lock);
    return NULL;
}

static void diagnosis_during_the_cycle(ecan_igh_context_t *context)
{
    static struct worker worker;
    pthread_t thread;
    long cycles = 0;
    int is_done = 0;

    memset(&worker, 0, sizeof(worker));
    SAME(0, pthread_mutex_init(&worker.lock, NULL));
    GOOD(ecan_igh_diagnostics_open(&worker.handle, context));
    SAME(0, pthread_create(&thread, NULL, run_worker, &worker));
    for (cycles = 0; cycles < 100000000L && !is_done; cycles++) {
        cycle(context);
        pthread_mutex_lock(&worker.lock);
        is_done = worker.is_done;
        pthread_mutex_unlock(&worker.lock);
    }
    SAME(1, is_done);
    SAME(0, pthread_join(thread, NULL));
    SAME(ECAN_OK, worker.upload);
    SAME(ECAN_ERR_SDO, worker.rejected);
    SAME(ABORT_NO_OBJECT, worker.abort_code);
    SAME(ECAN_ERR_SDO, worker.download);
    SAME(ECAN_OK, worker.state);
    SAME(1, worker.master.slaves_responding);
    SAME(1, ecan_igh_is_operational(context));
    GOOD(ecan_igh_diagnostics_deinit(&worker.handle));
    pthread_mutex_destroy(&worker.lock);
}

void test_adapter_sdo(void)
{
    static ecan_igh_config_t config;
    static igh_mcan_port_config_t port_config;
    ecan_igh_context_t context;
    ecan_igh_diagnostics_t handle;
    ecan_igh_master_state_t state;
    size_t request = 99;
    size_t small = 99;

    simulate_channel(&config, &port_config, "sim:echo", 1000000);
    GOOD(igh_mcan_port_apply_config(&config, &port_config));
    GOOD(ecan_igh_init(&context, &config));
    waiting_transfers(&context);
    create_requests(&context, &request, &small);
    handles(&context);
    GOOD(ecan_igh_wait_op_timeout(&context, 20000));
    waiting_transfers(&context);
    use_requests(&context, request, small);
    diagnosis_during_the_cycle(&context);

    /* A handle may outlive the context. */
    GOOD(ecan_igh_diagnostics_open(&handle, &context));
    GOOD(ecan_igh_deinit(&context));
    GOOD(ecan_igh_diagnostics_master_state(&handle, &state));
    GOOD(ecan_igh_diagnostics_deinit(&handle));
    no_diagnostics(ECAN_ERR_NOT_INITIALISED, &handle);
}
