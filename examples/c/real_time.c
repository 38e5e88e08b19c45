#include "real_time.h"

#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "report.h"

#define NS_PER_S 1000000000u

bool real_time_enter(int priority)
{
    struct sched_param parameters;
    memset(&parameters, 0, sizeof(parameters));
    parameters.sched_priority = priority;
    int fault = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
    if (fault != 0) {
        report("no SCHED_FIFO with priority %d: %s (root, CAP_SYS_NICE or an rtprio limit permit "
               "it)", priority, strerror(fault));
        return false;
    }
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
        report("memory cannot be locked: %s (root, CAP_IPC_LOCK or a memlock limit permit it)",
               strerror(errno));
        return false;
    }
    return true;
}

uint64_t monotonic_ns(void)
{
    /* The clock exists on every Linux, so that the call cannot fail. */
    struct timespec now = {0};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

void sleep_until(uint64_t deadline_ns, uint64_t spin_ns)
{
    uint64_t wake_ns = deadline_ns > spin_ns ? deadline_ns - spin_ns : 0;
    struct timespec wake = {
        .tv_sec = (time_t)(wake_ns / NS_PER_S),
        .tv_nsec = (long)(wake_ns % NS_PER_S)};
    /* A signal ends the sleep early; an absolute deadline is simply waited for again. */
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, NULL) == EINTR) {
    }
    while (monotonic_ns() < deadline_ns) {
    }
}
