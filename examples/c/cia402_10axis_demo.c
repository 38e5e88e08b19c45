/* Ten CiA 402 axes on one or more gateways (manual 15.6): startup and load test.
 *
 *     igh_cia402_10axis_demo --ecrt sim --slaves 1
 *     igh_cia402_10axis_demo --ecrt sim --cycle-us 1000 --dc-sync0 --dc-shift-us 700 --step 20
 */
#include "motion.h"
#include "options.h"
#include "report.h"

enum { AXES = 10 };

/* Distributes the axes over the channels of all gateways in turn; node-IDs start at 1 on each
 * channel. */
static void add_drives(motion_t *motion)
{
    size_t channels = (size_t)motion->bus.slaves * ECAN_MCAN_CHANNELS;
    for (size_t axis = 0; axis < AXES; axis++) {
        size_t index = axis % channels;
        motion_add_drive(motion, (drive_place_t){
            .slave = index / ECAN_MCAN_CHANNELS,
            .channel = (uint8_t)(index % ECAN_MCAN_CHANNELS),
            .node_id = (uint8_t)(axis / channels + 1)});
    }
}

int main(int argc, char **argv)
{
    motion_t motion;
    option_list_t list = {
        .about = "Enables ten CiA 402 axes, spread over the channels of all gateways, and moves "
                 "them by a step per target."};
    motion_default(&motion, 1000);
    motion.bus.slaves = 3;
    motion_add_options(&motion, &list);
    options_parse(&list, argc, argv);
    real_time_check(&motion.thread);

    add_drives(&motion);
    return report_exit_status(motion_run(&motion));
}
