/* One CiA 402 axis on a gateway (manual 15.6): configures it, enables it at its actual position,
 * and moves it step by step.
 *
 *     igh_cia402_single_axis_demo --ecrt sim --step 0
 *     igh_cia402_single_axis_demo --ecrt sim --step 100 --cycles 2000
 */
#include "motion.h"
#include "options.h"
#include "report.h"

int main(int argc, char **argv)
{
    motion_t motion;
    uint64_t channel = 0, node_id = 1;
    option_list_t list = {
        .about = "Enables one CiA 402 axis and moves it by a step per target."};
    motion_default(&motion, 20);
    motion_add_options(&motion, &list);
    options_add(&list, (option_t){
        .name = "channel", .value_name = "CHANNEL", .number = &channel,
        .maximum = ECAN_MCAN_CHANNELS - 1,
        .help = "CAN channel of the drive"});
    options_add(&list, (option_t){
        .name = "node", .value_name = "ID", .number = &node_id, .minimum = 1, .maximum = 127,
        .help = "Node-ID of the drive"});
    options_parse(&list, argc, argv);
    real_time_check(&motion.thread);

    motion_add_drive(&motion, (drive_place_t){
        .slave = 0, .channel = (uint8_t)channel, .node_id = (uint8_t)node_id});
    return report_exit_status(motion_run(&motion));
}
