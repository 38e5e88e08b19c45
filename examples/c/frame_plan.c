#include "frame_plan.h"

#include <stdio.h>

#include "igh_plan.h"
#include "report.h"

enum { STREAMS = 2 * ECAN_IGH_MAX_SLAVES * ECAN_MCAN_CHANNELS };

bool frame_plan_print(const bus_settings_t *settings, const igh_mcan_tx_frame_t *frame)
{
    static igh_mcan_frame_stream_t streams[STREAMS];
    static char text[PLAN_TEXT];
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t mcan_config;
    size_t count = 0;
    if (!bus_settings_configure(settings, &igh_config, &mcan_config)) {
        return false;
    }
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        for (uint8_t channel = 0; channel < ECAN_MCAN_CHANNELS; channel++) {
            if ((settings->channel_masks[slave] >> channel & 1) == 0) {
                continue;
            }
            for (uint8_t route = IGH_MCAN_ROUTE_TO_BUS; route <= IGH_MCAN_ROUTE_FROM_BUS; route++) {
                igh_mcan_frame_stream_t *stream = &streams[count++];
                *stream = (igh_mcan_frame_stream_t){.frame = *frame, .frames = 1, .route = route};
                stream->frame.slave = (uint16_t)slave;
                stream->frame.channel = channel;
                stream->frame.scheduled = route == IGH_MCAN_ROUTE_TO_BUS && frame->scheduled;
            }
        }
    }
    int code = igh_mcan_port_plan(&igh_config, &mcan_config, streams, count, text, sizeof(text),
                                  NULL);
    fputs(text, stdout);
    if (code != ECAN_OK) {
        report_sdk_error();
    }
    return code == ECAN_OK;
}
