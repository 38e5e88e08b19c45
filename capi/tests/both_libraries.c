/* Both libraries in one program: there is one last error, whichever library stores it. */
#include <stdio.h>
#include <string.h>

#include <igh_mcan_port.h>

static int shows(const char *function, int code)
{
    if (ecan_last_error_code() == code && strncmp(ecan_last_error(), function, strlen(function)) == 0) {
        return 1;
    }
    fprintf(stderr, "after %s: %d, %s\n", function, ecan_last_error_code(), ecan_last_error());
    return 0;
}

int main(void)
{
    ecan_igh_config_t config;

    ecan_igh_default_config(&config);
    if (ecan_igh_config_set_cycle_us(NULL, 1000) != ECAN_ERR_NULL ||
        !shows("ecan_igh_config_set_cycle_us: ", ECAN_ERR_NULL) ||
        igh_mcan_len_from_dlc(16, 0) != ECAN_ERR_ARGUMENT ||
        !shows("igh_mcan_len_from_dlc: ", ECAN_ERR_ARGUMENT) ||
        ecan_igh_config_set_cycle_us(&config, 0) == ECAN_OK ||
        !shows("ecan_igh_config_set_cycle_us: ", ECAN_ERR_ARGUMENT)) {
        return 1;
    }
    ecan_clear_last_error();
    if (ecan_last_error_code() != ECAN_OK || ecan_last_error()[0] != '\0') {
        fputs("the last error was not cleared\n", stderr);
        return 1;
    }
    puts("one last error");
    return 0;
}
