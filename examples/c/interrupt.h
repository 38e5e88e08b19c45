/* Ctrl-C, SIGTERM and SIGHUP as a flag that the cycle looks at. */
#ifndef INTERRUPT_H
#define INTERRUPT_H

#include <stdbool.h>

/* Catches the signals from now on; false, with a message on standard error, where the system does
 * not allow it. Until then a signal ends the program, which the EtherCAT master copes with. */
bool interrupt_install(void);

/* Whether the user asked the program to stop. */
bool interrupt_is_set(void);

#endif /* INTERRUPT_H */
