/* Calls every function of the C API, with valid and invalid arguments. */
#include "check.h"

int main(void)
{
    test_common();
    test_pdo();
    test_pdo_parse();
    test_adapter_config();
    test_adapter_life();
    test_adapter_cycle();
    test_adapter_sdo();
    test_port_config();
    test_config_file();
    test_config_file_run();
    test_port_life();
    test_port_service();
    test_port_cycle();
    test_port_schedule();
    test_cia402_axes();
    test_cia402_motion();
    test_cia402_sdo();
    test_cia402_further();
    test_cia402_node_axes();
    test_canopen_life();
    test_canopen_network();
    test_canopen_lss();
    test_plan();
    test_stop();
    test_reserved();
    test_observer();
    test_null_pointers();
    /* Last: it may raise the priority of the thread. */
    test_adapter_real_time();
    if (check_failures() > 0) {
        fprintf(stderr, "every_function: %lu of %lu checks failed\n", check_failures(),
                check_count());
        return 1;
    }
    printf("every_function: %lu checks hold\n", check_count());
    return 0;
}
