#include "interrupt.h"

#include <signal.h>
#include <string.h>

#include "report.h"

static volatile sig_atomic_t stop_requested = 0;

static void on_signal(int signal_number)
{
    (void)signal_number;
    stop_requested = 1;
}

bool interrupt_install(void)
{
    struct sigaction action;
    memset(&action, 0, sizeof(action));
    action.sa_handler = on_signal;
    /* Interrupted output to a terminal or a pipe continues. */
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    if (sigaction(SIGINT, &action, NULL) != 0 || sigaction(SIGTERM, &action, NULL) != 0 ||
        sigaction(SIGHUP, &action, NULL) != 0) {
        report_errno("cannot catch", "signals");
        return false;
    }
    return true;
}

bool interrupt_is_set(void)
{
    return stop_requested != 0;
}
