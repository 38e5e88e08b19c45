/* An application that was built for version 0.1. */
#include <stdio.h>

int ecan_version(void);
const char *ecan_last_error(void);

int main(void)
{
    printf("application of 0.1, library %d, last error \"%s\"\n", ecan_version(), ecan_last_error());
    return 0;
}
