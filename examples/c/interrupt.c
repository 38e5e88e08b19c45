#include "interrupt.h"

#include <signal.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "report.h"

/* Exit status after the second signal, as in shells for SIGINT. */
#define ENDED_BY_SIGNAL 130
/* Later signals within this time belong to the first: shells signal a process and its group. */
#define ONE_REQUEST_MS 200

static volatile sig_atomic_t stop_requested = 0;
/* Written before the flag is set, and not again. */
static struct timespec first_signal;

static long long elapsed_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (now.tv_sec - first_signal.tv_sec) * 1000LL +
           (now.tv_nsec - first_signal.tv_nsec) / 1000000;
}

/* The first signal requests a stop, which may take its whole time; the second one ends the program. */
static void on_signal(int signal_number)
{
    (void)signal_number;
    if (stop_requested == 0) {
        clock_gettime(CLOCK_MONOTONIC, &first_signal);
        stop_requested = 1;
    } else if (elapsed_ms() >= ONE_REQUEST_MS) {
        _exit(ENDED_BY_SIGNAL);
    }
}

bool interrupt_install(void)
{
    struct sigaction action;
    memset(&action, 0, sizeof(action));
    action.sa_handler = on_signal;
    /* Interrupted output to a terminal or a pipe continues. */
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaddset(&action.sa_mask, SIGINT);
    sigaddset(&action.sa_mask, SIGTERM);
    sigaddset(&action.sa_mask, SIGHUP);
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
