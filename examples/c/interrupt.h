/* Ctrl-C, SIGTERM and SIGHUP as a flag for the cycle. */
#ifndef INTERRUPT_H
#define INTERRUPT_H

#include <stdbool.h>

/* Installs the signal handlers. Returns false, with a message on standard error, if the system
 * denies it. Before this call a signal ends the program, which the EtherCAT master tolerates. */
bool interrupt_install(void);

/* Returns true if the user requested the end of the program. */
bool interrupt_is_set(void);

#endif /* INTERRUPT_H */
