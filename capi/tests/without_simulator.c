/* A library that was built without the simulator rejects the setting `sim`. */
#include <stdio.h>
#include <string.h>

#include "igh_adapter.h"

int main(void)
{
    ecan_igh_config_t config;
    ecan_igh_context_t igh;
    int code;

    if (ecan_igh_default_config(&config) != ECAN_OK ||
        ecan_igh_config_set_ecrt(&config, "sim:echo") != ECAN_OK) {
        fprintf(stderr, "%s\n", ecan_last_error());
        return 1;
    }
    code = ecan_igh_init(&igh, &config);
    printf("%s: %s\n", ecan_result_name(code), ecan_last_error());
    return code == ECAN_ERR_ECRT &&
           strstr(ecan_last_error(), "built without the simulator") != NULL ? 0 : 1;
}
