/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the MCAN Port (manual 15.1, 15.4, 15.5).
 *
 * CAN and CAN FD frames through ECAN-Lite gateways.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  Renamed: igh_mcan_frame_way_t to igh_mcan_frame_route_t, with its values. Fields: refused* to
 *          rejected*, is_holding to is_unconfirmed, way to route, refuse_without_margin to
 *          reject_without_margin, give_up_missed to discard_missed.
 *          Added: igh_mcan_port_set_direction_masks(), igh_mcan_port_get_direction_masks(),
 *          igh_mcan_port_get_schedule_fault(), igh_mcan_schedule_fault_t, the field depth of
 *          igh_mcan_schedule_settings_t.
 *          Added at the end: txpdo_discarded, txpdo_unknown and startup_requests of
 *          igh_mcan_statistics_t; frames_accepted, frames_lost, frames_unknown, frames_pending,
 *          frames_confirmed and frames_not_taken of igh_mcan_channel_statistics_t. frames_delivered
 *          counts frames that a gateway in OP took; frames_discarded only those that were not
 *          published; sessions_lost no losses during a verification.
 *          A configuration file with too many gateways or filters is ECAN_ERR_CONFIG.
 *          igh_mcan_port_is_ready() returns 0 after an error, no longer its code.
 *          igh_mcan_port_get_session() and igh_mcan_port_get_schedule_fault() return only the value.
 *          Added: ecan_open(), igh_mcan_port_next_change(), igh_mcan_port_check_delivery().
 *          Added: igh_mcan_port_get_session_text(), igh_mcan_port_get_schedule_fault_text().
 *          Added: igh_mcan_port_set_gateway_object(), igh_mcan_port_get_gateway_object().
 *          Added: igh_mcan_port_serve(), igh_mcan_port_end_service().
 *          Moved: igh_mcan_port_plan() to igh_plan.h.
 *          Removed: igh_mcan_port_load_config_ex(); igh_mcan_port_load_config() has its arguments. `count` of
 *          igh_mcan_port_parse_config() may be NULL.
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 *   0.1.0  First version.
 */
#ifndef IGH_MCAN_PORT_H
#define IGH_MCAN_PORT_H

#include "igh_adapter.h"
#include "igh_ecan_common.h"
#include "igh_mcan_pdo.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Configuration
 *
 * Plain data: it may be copied and needs no deinit. igh_mcan_port_apply_config() passes it to the
 * Adapter's configuration, whose startup SDOs it then determines.
 * --------------------------------------------------------------------------- */

/** Most filters of a configuration, of all channels together. */
#define IGH_MCAN_MAX_FILTERS 512

/** Configuration of the gateways. About 40 kilobytes. */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[5120];
} igh_mcan_port_config_t;

/**
 * Fills a configuration: no channel enabled, encapsulation 0, no options, pacing on.
 *
 * @param config  Is overwritten.
 *
 * @usage   not rt, any thread, any time
 */
int igh_mcan_port_default_config(igh_mcan_port_config_t *config);

/**
 * Applies a configuration to the Adapter's: ecan_igh_init() then registers PDO profiles, channel
 * masks, bit rates, filters and budgets as startup SDOs (manual 15.5.2, step 4). Is copied; call
 * it again after a change. Only the gateways of the first slave_count slaves count. Sets N of the slaves
 * for which the application has set none: 3, and 8 with a CAN FD channel (manual 5.2).
 *
 * Without this call the gateways keep their last configuration; a Port then verifies that it is
 * the Port's configuration.
 *
 * @usage   not rt, any thread, before ecan_igh_init
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error().
 */
int igh_mcan_port_apply_config(ecan_igh_config_t *igh_config,
                               const igh_mcan_port_config_t *config);

/**
 * Checks a configuration as a whole against that of the Adapter. igh_mcan_port_apply_config() and
 * igh_mcan_port_init() do it, too.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_apply_config().
 */
ECAN_MUST_CHECK
int igh_mcan_port_check_config(const ecan_igh_config_t *igh_config,
                               const igh_mcan_port_config_t *config);

/* ---------------------------------------------------------------------------
 * Configuration of a channel (manual 13.4)
 * --------------------------------------------------------------------------- */

/**
 * Sets the enabled channels of a gateway, and those of them for CAN FD.
 *
 * A channel that was enabled keeps its settings unless it changes between classic CAN and CAN FD;
 * a new one gets 500 kbit/s, with CAN FD and 5 Mbit/s in the data phase.
 *
 * @param channel_mask  Channels to enable, bit 0 for channel 0.
 * @param canfd_mask    Those of them for CAN FD.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for channels beyond 3, or CAN FD without the
 *          channel.
 */
int igh_mcan_port_set_channel_mask(igh_mcan_port_config_t *config,
                                   size_t slave,
                                   uint8_t channel_mask,
                                   uint8_t canfd_mask);

/**
 * Gets the enabled channels of a gateway, and those of them for CAN FD. Their bit rates are
 * objects 19 and 20 (igh_mcan_port_get_channel_object()).
 *
 * @param channel_mask  Gets the channels, bit 0 for channel 0.
 * @param canfd_mask    Gets those of them for CAN FD.
 *
 * @usage   not rt, any thread, any time
 */
int igh_mcan_port_get_channel_mask(const igh_mcan_port_config_t *config,
                                   size_t slave,
                                   uint8_t *channel_mask,
                                   uint8_t *canfd_mask);

/**
 * Sets the channel masks of both directions, objects 0x8010:04 and 0x8011:04 (manual 3). A channel
 * in one of them only sends or only receives. Until this call both have all enabled channels;
 * after it, enabling a channel does not add it to a mask.
 *
 * @param tx_mask  Channels whose frames the TxPDO carries to the host (they receive), bit 0 for
 *                 channel 0.
 * @param rx_mask  Channels that the RxPDO carries frames to (they send).
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for an empty mask or channels beyond 3.
 *          igh_mcan_port_apply_config() checks that the channels are enabled, and that each enabled
 *          channel is in a mask.
 */
int igh_mcan_port_set_direction_masks(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t tx_mask,
                                      uint8_t rx_mask);

/**
 * Gets the channel masks of both directions: those set, or the enabled channels.
 *
 * @param tx_mask  Gets the channels of the TxPDO, bit 0 for channel 0.
 * @param rx_mask  Gets the channels of the RxPDO.
 *
 * @usage   not rt, any thread, any time
 */
int igh_mcan_port_get_direction_masks(const igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t *tx_mask,
                                      uint8_t *rx_mask);

/**
 * Enables a channel for classic CAN, with all other settings at their defaults.
 *
 * @param bitrate  Bit/s.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL. igh_mcan_port_apply_config() checks the bit
 *          rate.
 */
int igh_mcan_port_set_classic_channel(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t channel,
                                      uint32_t bitrate);

/**
 * Enables a channel for CAN FD with bit rate switch and transmitter delay compensation (manual
 * 14.3), with all other settings at their defaults.
 *
 * @param nominal  Bit/s of the arbitration phase.
 * @param data     Bit/s of the data phase.
 *
 * @usage   not rt, any thread, before apply
 * @return  As igh_mcan_port_set_classic_channel().
 */
int igh_mcan_port_set_canfd_channel(igh_mcan_port_config_t *config,
                                    size_t slave,
                                    uint8_t channel,
                                    uint32_t nominal,
                                    uint32_t data);

/**
 * Sets the windows from which the firmware selects the sample points. By default one sample point:
 * 87.5 %, or the next smaller one that the bit rate allows (manual 5.4.3).
 *
 * @param nominal_min, nominal_max  Arbitration phase, in 0.1 %.
 * @param data_min, data_max        Data phase, in 0.1 %.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_set_sample_points(igh_mcan_port_config_t *config,
                                    size_t slave,
                                    uint8_t channel,
                                    uint16_t nominal_min,
                                    uint16_t nominal_max,
                                    uint16_t data_min,
                                    uint16_t data_max);

/**
 * Sets the traffic for budgets and Message RAM of a channel (manual 13.2.2); 8 and 8
 * by default.
 *
 * @param received  Frames from the bus per cycle; at most 8 are drained.
 * @param sent      Frames to the bus per cycle; at most 8 are served.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_set_traffic(igh_mcan_port_config_t *config,
                              size_t slave,
                              uint8_t channel,
                              uint8_t received,
                              uint8_t sent);

/**
 * Sets a configuration object of a channel, 0x8001..0x8004, by the manual's (decimal) subindex:
 * bit timing mode (7), node mode (8), manual timing (25 to 32), delay compensation (16, 33, 34),
 * Message RAM, timestamps and all others of manual 13.4. Filters have their own functions.
 *
 * @param subindex  7 and up.
 * @param value     As for an SDO download.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT for a subindex without configuration or an invalid value;
 *          ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 */
ECAN_MUST_CHECK
int igh_mcan_port_set_channel_object(igh_mcan_port_config_t *config,
                                     size_t slave,
                                     uint8_t channel,
                                     uint8_t subindex,
                                     uint32_t value);

/**
 * Gets a configuration object of a channel by its subindex.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_set_channel_object().
 */
int igh_mcan_port_get_channel_object(const igh_mcan_port_config_t *config,
                                     size_t slave,
                                     uint8_t channel,
                                     uint8_t subindex,
                                     uint32_t *value);

/**
 * Sets a policy object of a channel's data path, 0x8021..0x8024, by the manual's (decimal)
 * subindex (13.2.2): budgets, caches, overflow and critical-frame policies, bus-off recovery.
 *
 * @param subindex  1, 4 to 19.
 * @param value     As for an SDO download.
 *
 * @usage   not rt, any thread, before apply
 * @return  As igh_mcan_port_set_channel_object().
 */
ECAN_MUST_CHECK
int igh_mcan_port_set_data_path_object(igh_mcan_port_config_t *config,
                                       size_t slave,
                                       uint8_t channel,
                                       uint8_t subindex,
                                       uint32_t value);

/**
 * Gets a policy object of a channel's data path by its subindex.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_set_channel_object().
 */
int igh_mcan_port_get_data_path_object(const igh_mcan_port_config_t *config,
                                       size_t slave,
                                       uint8_t channel,
                                       uint8_t subindex,
                                       uint32_t *value);

/**
 * Sets an entry of a configuration object of a gateway by index and (decimal) subindex of the manual:
 * pin rotation and the other entries of 0x8000 (13.3), 0x8001..0x8004, 0x8010:04 to :07 and 0x8011:04
 * to :07 (13.2), 0x8020, 0x8021..0x8024, the diagnostic test 0x8030 (13.2.3) and the access timeout
 * 0xB000:03 (13.7). An entry of 0x8000, 0x8020, 0x8030 or 0xB000 that is never set is not written.
 *
 * @param value  As for an SDO download. Its range is checked with the whole configuration.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_ARGUMENT for an entry without configuration, of a channel
 *          that is not enabled, or an invalid value.
 */
ECAN_MUST_CHECK
int igh_mcan_port_set_gateway_object(igh_mcan_port_config_t *config,
                                     size_t slave,
                                     uint16_t index,
                                     uint8_t subindex,
                                     uint32_t value);

/**
 * Gets an entry that igh_mcan_port_set_gateway_object() sets.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_set_gateway_object(); ECAN_ERR_ARGUMENT also for one that was never set.
 */
int igh_mcan_port_get_gateway_object(const igh_mcan_port_config_t *config,
                                     size_t slave,
                                     uint16_t index,
                                     uint8_t subindex,
                                     uint32_t *value);

/* ---------------------------------------------------------------------------
 * Acceptance filters (manual 13.4)
 * --------------------------------------------------------------------------- */

/** Match rule of a filter. */
typedef enum {
    /** From id1 to id2, both included; extended CAN IDs after the channel's global mask. */
    IGH_MCAN_MATCH_RANGE = 0,
    /** id1 and id2. */
    IGH_MCAN_MATCH_TWO = 1,
    /** CAN IDs that equal id1 in the bits set in id2. */
    IGH_MCAN_MATCH_MASKED = 2,
    /** Extended filters: from id1 to id2 without the global mask. Standard filters: no CAN ID. */
    IGH_MCAN_MATCH_RANGE_UNMASKED = 3
} igh_mcan_match_t;

/** Action for a frame that a filter matches. */
typedef enum {
    /** The filter is disabled. */
    IGH_MCAN_FILTER_DISABLED = 0,
    /** Into RX FIFO 0. */
    IGH_MCAN_FILTER_FIFO0 = 1,
    /** Into RX FIFO 1. */
    IGH_MCAN_FILTER_FIFO1 = 2,
    /** Rejected. */
    IGH_MCAN_FILTER_REJECT = 3,
    /** Marked as a priority message; later filters select the buffer. */
    IGH_MCAN_FILTER_PRIORITY = 4,
    /** Marked as a priority message, into RX FIFO 0. */
    IGH_MCAN_FILTER_PRIORITY_FIFO0 = 5,
    /** Marked as a priority message, into RX FIFO 1. */
    IGH_MCAN_FILTER_PRIORITY_FIFO1 = 6,
    /** Into the receive buffer with number id2; the filter matches only id1. */
    IGH_MCAN_FILTER_BUFFER = 7
} igh_mcan_filter_action_t;

/**
 * Adds a filter for 11-bit CAN IDs after the existing ones of the channel; at most 64.
 *
 * 0x8001:36 accepts or rejects frames that no filter matches (igh_mcan_port_set_channel_object()).
 *
 * @param matching  An igh_mcan_match_t.
 * @param action    An igh_mcan_filter_action_t.
 * @param id1, id2  CAN IDs, or CAN ID and mask.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond
 *          IGH_MCAN_MAX_FILTERS.
 */
ECAN_MUST_CHECK
int igh_mcan_port_add_standard_filter(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t channel,
                                      int matching,
                                      int action,
                                      uint16_t id1,
                                      uint16_t id2);

/**
 * Adds a filter for 29-bit CAN IDs; as igh_mcan_port_add_standard_filter(), at most 24.
 *
 * @usage   not rt, any thread, before apply
 * @return  As there.
 */
ECAN_MUST_CHECK
int igh_mcan_port_add_extended_filter(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t channel,
                                      int matching,
                                      int action,
                                      uint32_t id1,
                                      uint32_t id2);

/**
 * Removes all filters of a channel.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_clear_filters(igh_mcan_port_config_t *config, size_t slave, uint8_t channel);

/* ---------------------------------------------------------------------------
 * Configuration of a gateway
 * --------------------------------------------------------------------------- */

/**
 * Sets the encapsulation profiles: 0x8010:05 and 0x8011:05 (manual 9); 0 by default.
 *
 * @param tx_encapsulation  Of the TxPDO, slave to master: an igh_mcan_encapsulation_t. 1 and 5
 *                          bring timestamps.
 * @param rx_encapsulation  Of the RxPDO.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_encapsulation(igh_mcan_port_config_t *config,
                                    size_t slave,
                                    int tx_encapsulation,
                                    int rx_encapsulation);

/**
 * Sets the budget policies of the images: 0x8010:06 and 0x8011:06 (manual 12); balanced by
 * default.
 *
 * @param tx_budget, rx_budget  An igh_mcan_budget_t each.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_budget(igh_mcan_port_config_t *config,
                             size_t slave,
                             int tx_budget,
                             int rx_budget);

/**
 * Sets the options of the images: 0x8010:07 and 0x8011:07 (manual 9.1); none by default.
 *
 * @param tx_options  IGH_MCAN_OPTION_ values; _TX_RESULT reports the result of every transmission.
 * @param rx_options  IGH_MCAN_OPTION_ values except _TX_RESULT.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_options(igh_mcan_port_config_t *config,
                              size_t slave,
                              uint8_t tx_options,
                              uint8_t rx_options);

/**
 * Enables pacing, which is on by default: frames that would overflow the gateway's transmit queue,
 * or for a channel that is bus-off, are rejected. Without pacing the queue drops them.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_set_paced(igh_mcan_port_config_t *config, size_t slave, int paced);

/**
 * Sets the limits after which a gateway that was ready counts as lost: nothing is sent until it is
 * verified again.
 *
 * @param hold_limit   Consecutive images without confirmed delivery; 10 by default.
 * @param input_limit  Consecutive cycles without a new TxPDO image; 100 by default, 0 for no
 *                     limit.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_set_limits(igh_mcan_port_config_t *config,
                             size_t slave,
                             uint16_t hold_limit,
                             uint16_t input_limit);

/**
 * Allows the application bypass and the tests of 0x8030, which disconnect the CAN side; otherwise
 * a Port that finds them active does not start.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_allow_diagnostic_tests(igh_mcan_port_config_t *config, size_t slave, int allow);

/* ---------------------------------------------------------------------------
 * Configuration from a file
 *
 * One TOML file describes the gateways of a bus: their positions, PDO sizes, distributed clocks,
 * channels with bit rates, filters and policies. `ecan config example` prints one with every key;
 * `ecan config` also checks, compares and exports the file that an application loads.
 *
 * ecan_open(&igh, &mcan, "cell.toml");                  master and gateways, ready for frames
 * igh_cia402_context_init_file(&axes, &mcan, "cell.toml", NULL);
 *
 * An application that changes what it loads takes the steps of this call one by one:
 *
 * ecan_igh_default_config(&igh_config);
 * if (igh_mcan_port_load_config(&igh_config, &mcan_config, "cell.toml", NULL, 0, NULL) != ECAN_OK) {
 *     fprintf(stderr, "%s\n", ecan_last_error());    every fault, with line and column
 * }
 * ecan_igh_init(&igh, &igh_config);
 * igh_mcan_port_init(&mcan, &igh, &mcan_config);
 * --------------------------------------------------------------------------- */

/** Bytes of the text of a fault, NUL included. */
#define IGH_MCAN_FILE_FAULT_BYTES 248

/** A fault of a configuration file. */
typedef struct {
    /** Line, from 1. */
    uint32_t line;
    /** Column in characters, from 1. */
    uint32_t column;
    /** Reason, in UTF-8; cut if it does not fit. */
    char reason[IGH_MCAN_FILE_FAULT_BYTES];
    /** Zero; for fields of later versions. */
    uint32_t reserved[6];
} igh_mcan_file_fault_t;

/**
 * Loads the configurations of the Adapter and of the Port from a file. They are applied, as by
 * igh_mcan_port_apply_config(): ecan_igh_init() and igh_mcan_port_init() are all that is left.
 *
 * Everything in the file reaches the gateways, and keys that it does not have get the file's
 * defaults, for any previous content. Other functions may change both afterwards; apply changes of
 * `config` again.
 *
 * @param igh_config  Initialised. Settings that a file does not have stay: the library (setting
 *                    `ecrt`), scenario, clock and seed of a simulation. Everything else is
 *                    replaced, startup SDOs included. Policies of 0x8020 become startup SDOs, 6
 *                    per gateway with policies, and count for ECAN_IGH_MAX_STARTUP_SDOS.
 * @param config      Is overwritten.
 * @param path        Path of the file, relative to the working directory; "-" is standard input.
 * @param faults      Gets the faults that fit, in the order of the lines, for an editor for example;
 *                    may be NULL if capacity is 0. ecan_last_error() holds some eighty of them.
 * @param capacity    Size of `faults`.
 * @param count       Gets the number of all faults, 0 for every other error; may be NULL.
 *
 * @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
 * @return  ECAN_OK; ECAN_ERR_FILE if it cannot be read; ECAN_ERR_CONFIG with every fault in
 *          ecan_last_error(), by line and column, also for more than ECAN_IGH_MAX_SLAVES gateways
 *          or IGH_MCAN_MAX_FILTERS filters. An error changes neither configuration.
 */
ECAN_MUST_CHECK
int igh_mcan_port_load_config(ecan_igh_config_t *igh_config,
                              igh_mcan_port_config_t *config,
                              const char *path,
                              igh_mcan_file_fault_t *faults,
                              size_t capacity,
                              size_t *count);

/**
 * As igh_mcan_port_load_config(), from a text in memory.
 *
 * @param text  Content of the file, up to a NUL.
 *
 * @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
 * @return  As igh_mcan_port_load_config(), except ECAN_ERR_FILE.
 */
ECAN_MUST_CHECK
int igh_mcan_port_parse_config(ecan_igh_config_t *igh_config,
                               igh_mcan_port_config_t *config,
                               const char *text,
                               igh_mcan_file_fault_t *faults,
                               size_t capacity,
                               size_t *count);

/* ---------------------------------------------------------------------------
 * Life of a Port
 * --------------------------------------------------------------------------- */

/**
 * CAN and CAN FD through the gateways of one master. Belongs to the thread of the cycle; do not
 * move or copy it. Ends with its ecan_igh_context_t at the latest.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} igh_mcan_port_t;

/**
 * Opens what a configuration file describes: loads the library that the environment variable ECAN_ECRT
 * selects, opens the master and the gateways, and waits until frames can be sent. Blocks for seconds. A plain
 * "sim" has the gateways, nodes and axes of the file. ecan_igh_deinit() closes everything.
 *
 * @param igh   Any content.
 * @param port  Any content.
 * @param path  As of igh_mcan_port_load_config().
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  As igh_mcan_port_load_config(), ecan_igh_init(), igh_mcan_port_init() and
 *          ecan_igh_wait_op_timeout(). After an error there is nothing to deinit.
 */
ECAN_MUST_CHECK
int ecan_open(ecan_igh_context_t *igh,
              igh_mcan_port_t *port,
              const char *path);

/**
 * Opens a Port on a master that is not active yet. ecan_igh_wait_op_timeout() then waits until the
 * gateways are ready.
 *
 * @param port    Any content; the manual's fragments leave it uninitialised.
 * @param igh     The master. Must not move while the Port is used.
 * @param config  The configuration that was applied with igh_mcan_port_apply_config(). Is copied.
 *
 * @usage   not rt, the cycle's thread, after ecan_igh_init and before the bus is active
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault, or for another configuration than the one
 *          that was applied; ECAN_ERR_ORDER if there is a Port already or the bus is active;
 *          ECAN_ERR_SDO, ECAN_ERR_MASTER. An error does not change the master.
 */
int igh_mcan_port_init(igh_mcan_port_t *port,
                       ecan_igh_context_t *igh,
                       const igh_mcan_port_config_t *config);

/**
 * Configures the gateways again, to change N or channels at run time (manual 14.2). Then wait for
 * OP again. Frames that were not delivered are lost, statistics restart, axes on the Port end.
 *
 * @param igh_config  Of the Adapter; the Port's part of it is `config`.
 * @param config      Of the gateways.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  As ecan_igh_init(); a faulty configuration changes nothing. After any other error
 *          reconfigure again. ECAN_ERR_ATTACHED.
 */
ECAN_MUST_CHECK
int igh_mcan_port_reconfigure(igh_mcan_port_t *port,
                              const ecan_igh_config_t *igh_config,
                              const igh_mcan_port_config_t *config);

/**
 * Returns 1 if every gateway is ready: in OP and verified.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int igh_mcan_port_is_ready(igh_mcan_port_t *port);

/**
 * Closes the Port; the master stays active. Axes on the Port end: those that may move are stopped before,
 * as by igh_cia402_context_deinit().
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also for a Port that is closed already or was never opened.
 *          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
 *          move; the Port is closed nevertheless.
 */
int igh_mcan_port_deinit(igh_mcan_port_t *port);

/* ---------------------------------------------------------------------------
 * The cycle
 *
 * igh_mcan_port_wait_next_cycle(&mcan);
 * igh_mcan_port_cycle_begin(&mcan);
 * igh_mcan_port_receive(&mcan, rx, 32, &rx_count);
 * igh_mcan_port_send_can(&mcan, 0, 0, 0x123, 0, data, 8);
 * igh_mcan_port_cycle_end(&mcan);
 * --------------------------------------------------------------------------- */

/**
 * Sleeps until the next deadline; as ecan_igh_wait_next_cycle().
 *
 * @usage   rt, the cycle's thread, active bus
 */
int igh_mcan_port_wait_next_cycle(igh_mcan_port_t *port);

/**
 * Receives and checks the images, and continues the verification of gateways. First in the cycle.
 * Items of the last cycle that were not received are dropped. Does nothing while a cycle is open.
 * Copy the text of an error if you need it: a frame that is rejected later in the cycle replaces
 * it.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: the cycle is open, call
 *          igh_mcan_port_cycle_end() in any case. ECAN_ERR_ORDER if the bus is not active.
 */
int igh_mcan_port_cycle_begin(igh_mcan_port_t *port);

/**
 * Publishes the images, or repeats unconfirmed ones, and sends. Last in the cycle.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: continue with the next
 *          cycle; ECAN_ERR_ORDER if the bus is not active.
 */
int igh_mcan_port_cycle_end(igh_mcan_port_t *port);

/**
 * Receives items: frames of the buses and, with the option TX_RESULT, results of transmissions
 * (kind), in the order of the images and of the slaves. Items that do not fit remain for another
 * call in the same cycle.
 *
 * @param rx        Gets the items.
 * @param capacity  Items that fit.
 * @param rx_count  Gets the number of items.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open.
 */
int igh_mcan_port_receive(igh_mcan_port_t *port,
                          igh_mcan_rx_frame_t *rx,
                          size_t capacity,
                          size_t *rx_count);

/* ---------------------------------------------------------------------------
 * Sending
 *
 * A packet is written once, directly into the PDO image. A rejected frame has no effect; after
 * some codes it may be sent again in a later cycle (ecan_result_is_temporary()).
 * --------------------------------------------------------------------------- */

/** Image and index of a sent frame, as in an igh_mcan_rx_frame_t of kind IGH_MCAN_RX_TX_RESULT. */
typedef struct {
    /** Slave index. */
    uint16_t slave;
    /** Sequence of the image. */
    uint16_t sequence;
    /** Index of the frame in the image, from 0. */
    uint8_t frame_index;
    /** Zero; for fields of later versions. */
    uint8_t reserved[11];
} igh_mcan_ticket_t;

/**
 * Sends a classic CAN frame.
 *
 * @param slave    Slave index.
 * @param channel  Channel of the gateway, 0 to 3.
 * @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
 * @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
 * @param data     Data; may be NULL if len is 0 and for a remote frame.
 * @param len      Bytes, 0 to 8; of a remote frame the requested DLC.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_NO_ROOM, ECAN_ERR_QUEUE_FULL, ECAN_ERR_BUS_OFF, ECAN_ERR_NOT_READY:
 *          temporary; ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_FRAME; ECAN_ERR_ORDER if no
 *          cycle is open.
 */
int igh_mcan_port_send_can(igh_mcan_port_t *port,
                           size_t slave,
                           uint8_t channel,
                           uint32_t can_id,
                           uint8_t flags,
                           const uint8_t *data,
                           size_t len);

/**
 * Sends a CAN FD frame.
 *
 * @param flags  0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI; IGH_MCAN_FLAG_FD is
 *               accepted.
 * @param len    Bytes: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 (manual 8.2).
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_mcan_port_send_can(); ECAN_ERR_NOT_FD for a channel of classic CAN.
 */
int igh_mcan_port_send_canfd(igh_mcan_port_t *port,
                             size_t slave,
                             uint8_t channel,
                             uint32_t can_id,
                             uint8_t flags,
                             const uint8_t *data,
                             size_t len);

/**
 * Sends a classic CAN frame at a phase of the next Sync0 period (manual 8.4, 13.8). Needs
 * distributed clocks. The gateway drops a frame that arrives after its phase.
 *
 * @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
 * @param tag        Tag of the application.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_mcan_port_send_can(); ECAN_ERR_SCHEDULE if it cannot be scheduled.
 */
int igh_mcan_port_schedule_can(igh_mcan_port_t *port,
                               size_t slave,
                               uint8_t channel,
                               uint32_t can_id,
                               uint8_t flags,
                               const uint8_t *data,
                               size_t len,
                               uint32_t offset_ns,
                               uint16_t tag);

/**
 * Sends a CAN FD frame at a phase of the next Sync0 period; as igh_mcan_port_schedule_can().
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_mcan_port_send_canfd(); ECAN_ERR_SCHEDULE if it cannot be scheduled.
 */
int igh_mcan_port_schedule_canfd(igh_mcan_port_t *port,
                                 size_t slave,
                                 uint8_t channel,
                                 uint32_t can_id,
                                 uint8_t flags,
                                 const uint8_t *data,
                                 size_t len,
                                 uint32_t offset_ns,
                                 uint16_t tag);

/**
 * Sends a frame that igh_mcan_tx_frame_set_can() or a similar function filled.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As the functions above; ECAN_ERR_ARGUMENT for an unknown hint.
 */
int igh_mcan_port_send(igh_mcan_port_t *port, const igh_mcan_tx_frame_t *frame);

/**
 * Sends frames in order and stops at the first rejected one, so that the order is kept if the rest
 * is sent in a later cycle.
 *
 * @param sent  Gets the number of sent frames, from the first one.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK if all were sent; otherwise the code of the rejected one, as
 *          igh_mcan_port_send().
 */
int igh_mcan_port_send_batch(igh_mcan_port_t *port,
                             const igh_mcan_tx_frame_t *frames,
                             size_t count,
                             size_t *sent);

/**
 * Runs one whole cycle, for test scripts: begin, receive, send, end. The caller keeps the period.
 *
 * @param tx        Frames to send; may be NULL if tx_count is 0.
 * @param rx        Gets the received items.
 * @param rx_count  Gets the number of received items.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK if all frames were sent; otherwise the first error, as the functions that it
 *          stands for. The cycle is complete in any case.
 */
int igh_mcan_port_exchange(igh_mcan_port_t *port,
                           const igh_mcan_tx_frame_t *tx,
                           size_t tx_count,
                           igh_mcan_rx_frame_t *rx,
                           size_t capacity,
                           size_t *rx_count);

/**
 * Gets image and index of the frame that was sent last. Call it after the send whose TX_RESULT you
 * need.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ORDER if nothing was sent yet.
 */
int igh_mcan_port_get_last_ticket(igh_mcan_port_t *port, igh_mcan_ticket_t *ticket);

/**
 * Returns the free bytes in the image of this cycle; a packet needs 4 to 78 of them (manual 8.3).
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The bytes; 0 if the slave is not configured.
 */
size_t igh_mcan_port_image_room(igh_mcan_port_t *port, size_t slave);

/**
 * Discards every frame whose delivery to the gateway is not confirmed. The gateway may still have
 * executed frames of an unconfirmed image.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number of discarded frames, 0 or more; ECAN_ERR_SLAVE.
 */
int igh_mcan_port_discard_pending(igh_mcan_port_t *port, size_t slave);

/* ---------------------------------------------------------------------------
 * Service for other programs
 *
 * Programs such as `ecan monitor`, `ecan dump` and `ecan diag`, and clients in any language, take part
 * in the bus while the application runs its cycle: they connect to a Unix socket (docs/SERVICE.md). The
 * cycle copies its images to bounded memory and waits for no client.
 * --------------------------------------------------------------------------- */

/**
 * Clients of the same user, and of root, may control the bus: send frames, download SDOs, send NMT
 * commands. Without a flag every client only reads.
 */
#define IGH_MCAN_SERVE_CONTROL 1

/** Every client that may open the socket may control the bus. */
#define IGH_MCAN_SERVE_CONTROL_ALL 2

/**
 * Starts a service for other programs on threads of its own; it replaces an earlier one. It ends with
 * igh_mcan_port_end_service() or with the Port, and continues after a reconfiguration.
 *
 * @param path   Path of the socket, with the permissions 0660. Its directory is created, not those
 *               above. /run/ecan/master0.sock is where `ecan` looks for the service of master 0.
 * @param flags  0, IGH_MCAN_SERVE_CONTROL or IGH_MCAN_SERVE_CONTROL_ALL.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_FILE if another service uses the socket or it cannot be created;
 *          ECAN_ERR_ARGUMENT for an unknown flag. After an error there is no service.
 */
ECAN_MUST_CHECK
int igh_mcan_port_serve(igh_mcan_port_t *port,
                        const char *path,
                        uint32_t flags);

/**
 * Ends the service: closes its connections and removes its socket.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, also without a service.
 */
int igh_mcan_port_end_service(igh_mcan_port_t *port);

/* ---------------------------------------------------------------------------
 * Scheduled transmission
 *
 * Frames sent at a phase of Sync0 (manual 8.4, 13.8, 13.9): the margin of their transport and
 * their results, as the gateway reports them. igh_mcan_port_schedule_can() and similar functions
 * send them.
 * --------------------------------------------------------------------------- */

/** Flag of 0xB000:06: a scheduled frame was dropped because its phase had passed. */
#define IGH_MCAN_SCHEDULE_LATE_DROP 64

/** Flag of 0xB000:06: a scheduled frame found the queue full. */
#define IGH_MCAN_SCHEDULE_QUEUE_FULL 128

/** Flag of 0xB000:06: the CAN controller rejected a scheduled frame at its phase. */
#define IGH_MCAN_SCHEDULE_TX_FAIL 256

/** Flag of 0xB000:06: the timer missed a phase. */
#define IGH_MCAN_SCHEDULE_TIMER_MISS 512

/** Reason for which a gateway's account of scheduled frames counts accepted frames as unknown. */
typedef enum {
    /** None: the results are certain, or no flags were read yet. */
    IGH_MCAN_SCHEDULE_FAULT_NONE = 0,
    /** Flags of 0xB000:06 report problems, but not of which frames; they stay until they are cleared. */
    IGH_MCAN_SCHEDULE_FAULT_FLAGGED = 1,
    /** An object that decides on accepted frames cannot be read; the text names it. */
    IGH_MCAN_SCHEDULE_FAULT_UNREADABLE = 3,
    /** Another one; see the text. */
    IGH_MCAN_SCHEDULE_FAULT_OTHER = 255
} igh_mcan_schedule_fault_t;

/**
 * Times for the margin of a schedule, and the reaction to a missing margin. The manual gives
 * no times; docs/ASSUMPTIONS.md gives the source of the defaults.
 */
typedef struct {
    /** Latest time after the deadline at which the cycle is sent, in nanoseconds. */
    uint32_t latest_send_ns;
    /** Time of an image in host and network card, in nanoseconds, without its time on the wire. */
    uint32_t transport_ns;
    /** Time of the firmware until a frame waits for its phase, in nanoseconds. */
    uint32_t processing_ns;
    /**
     * Interval at which the gateway's diagnostics are read after the first scheduled frame, in
     * milliseconds; 0 never reads them.
     */
    uint32_t watch_ms;
    /** 1 rejects frames without margin; 0 sends and counts them. */
    uint8_t reject_without_margin;
    /**
     * 1 discards an unconfirmed image that contains only scheduled frames: repeated, they
     * could be sent a period late.
     */
    uint8_t discard_missed;
    /** Scheduled frames that the gateway holds, for the plan; 0 for the default. */
    uint16_t depth;
    /** Must be 0; for fields of later versions. */
    uint32_t reserved[7];
} igh_mcan_schedule_settings_t;

/**
 * Times around the Sync0 pulse that is the reference of a scheduled frame's offset, in
 * nanoseconds from the deadline of the cycle.
 */
typedef struct {
    /** Earliest arrival of the image in the gateway. */
    uint64_t earliest_arrival_ns;
    /** Latest arrival of the image in the gateway. */
    uint64_t latest_arrival_ns;
    /** The pulse that is the reference of the offset. */
    uint64_t pulse_ns;
    /** The phase at which the frame is sent. */
    uint64_t release_ns;
    /** From the pulse before to the earliest arrival. */
    int64_t after_pulse_ns;
    /** From the latest arrival to the pulse; negative if the pulse falls among the arrivals. */
    int64_t before_pulse_ns;
    /** From the end of the firmware's work to the phase; negative if frames may be dropped. */
    int64_t before_release_ns;
    /** The smallest of the three. */
    int64_t least_ns;
    /** Zero; for fields of later versions. */
    uint64_t reserved[4];
} igh_mcan_schedule_margin_t;

/**
 * Results of a channel's scheduled frames. `scheduled` is the sum of `sent` to `open`; all
 * except `open` only grow.
 */
typedef struct {
    /** Accepted frames. */
    uint64_t scheduled;
    /**
     * Frames that the gateway accepted and, by its flags, passed to the CAN controller at
     * their phase.
     */
    uint64_t sent;
    /** Frames that the gateway rejected because its schedule was full. Needs TX_RESULT. */
    uint64_t queue_full;
    /**
     * Frames that the gateway rejected for another reason: bus busy, bus-off, channel not enabled. Needs
     * TX_RESULT.
     */
    uint64_t not_sent;
    /**
     * Frames that the host did not send: discarded, or removed because the cycle ended too
     * late.
     */
    uint64_t withdrawn;
    /** Frames with an unknown result, for example of an image that was repeated a period late. */
    uint64_t unknown;
    /** Frames without a result so far. */
    uint64_t open;
    /** Frames that were rejected because their cycle began too late for the phase. */
    uint64_t rejected_late;
    /** Frames among `scheduled` that were accepted without margin. */
    uint64_t without_margin;
    /** Zero; for fields of later versions. */
    uint64_t reserved[7];
} igh_mcan_schedule_account_t;

/** Counters of one channel, 0x9020 to 0x9023 (manual 13.2.5). */
typedef struct {
    /** :11 Times that the controller's FIFO was full. */
    uint32_t fifo_full;
    /** :12 Frames dropped as stale. */
    uint32_t stale_drops;
    /** :13 Times that the channel was bus-off. */
    uint32_t bus_offs;
    /** Zero; for fields of later versions. */
    uint32_t reserved[3];
} igh_mcan_channel_drops_t;

/**
 * Diagnostics of a gateway's scheduled transmission. Each reading contains flags, stale_drops
 * and bus_offs, and one of the other objects in turn.
 */
typedef struct {
    /** Time at which the flags were read, on the clock of ecan_igh_now_ns(). */
    uint64_t read_at_ns;
    /** Per channel; all 0 for one that is not enabled. */
    igh_mcan_channel_drops_t channels[ECAN_MCAN_CHANNELS];
    /** 0x9011:02 Number of Sync0 pulses. */
    uint32_t sync0_count;
    /**
     * 0x9011:04 Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles
     * of the gateway (0x8000:04).
     */
    int32_t phase_min_cycles;
    /** 0x9011:05 Largest such distance. */
    int32_t phase_max_cycles;
    /** 0x9011:13 Longest service of scheduled frames, in CPU cycles. */
    uint32_t service_max_cycles;
    /**
     * 0xB000:06 IGH_MCAN_SCHEDULE_ values and others (manual 13.7); they stay until they are
     * cleared.
     */
    uint16_t flags;
    /** Zero; for fields of later versions. */
    uint8_t reserved[30];
} igh_mcan_schedule_diagnostics_t;

/**
 * Fills the settings with their defaults.
 *
 * @usage   rt, any thread, any time
 */
int igh_mcan_port_default_schedule(igh_mcan_schedule_settings_t *settings);

/**
 * Sets the schedule settings of a gateway.
 *
 * @usage   not rt, any thread, before apply
 */
int igh_mcan_port_set_schedule(igh_mcan_port_config_t *config,
                               size_t slave,
                               const igh_mcan_schedule_settings_t *settings);

/**
 * Gets the margin of an offset against cycle, wire and firmware.
 *
 * @param offset_ns  Time after Sync0, in nanoseconds.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, for every margin; ECAN_ERR_SCHEDULE for an offset that cannot be scheduled at
 *          all; ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_schedule_margin(igh_mcan_port_t *port,
                                      size_t slave,
                                      uint32_t offset_ns,
                                      igh_mcan_schedule_margin_t *margin);

/**
 * Gets the results of a channel's scheduled frames.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_schedule_account(igh_mcan_port_t *port,
                                       size_t slave,
                                       uint8_t channel,
                                       igh_mcan_schedule_account_t *account);

/**
 * Gets the last diagnostics of a gateway's scheduled transmission.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NOT_READY until each object was read in this session; ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_schedule_diagnostics(igh_mcan_port_t *port,
                                           size_t slave,
                                           igh_mcan_schedule_diagnostics_t *diagnostics);

/**
 * Returns the reason for which the accounts of a gateway's scheduled frames count accepted frames as
 * unknown, by the last reading of its flags.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  An igh_mcan_schedule_fault_t; ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_schedule_fault(igh_mcan_port_t *port,
                                     size_t slave);

/**
 * Gets the reason of igh_mcan_port_get_schedule_fault() as text, with what to do; empty without a
 * reason.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_BUFFER.
 */
int igh_mcan_port_get_schedule_fault_text(igh_mcan_port_t *port,
                                          size_t slave,
                                          char *text,
                                          size_t size,
                                          size_t *needed);

/**
 * Clears the flags of 0xB000:06 and the gateway's other runtime diagnostics in the next cycles
 * (manual 13.7, bit 5).
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_clear_schedule_flags(igh_mcan_port_t *port, size_t slave);

/* ---------------------------------------------------------------------------
 * State of gateways and channels
 * --------------------------------------------------------------------------- */

/** State of a gateway's session. */
typedef enum {
    /** The slave is not in OP, or its process data are missing. */
    IGH_MCAN_SESSION_WAITING = 0,
    /** In OP, being verified; only empty images are sent. */
    IGH_MCAN_SESSION_VERIFYING = 1,
    /** Ready. */
    IGH_MCAN_SESSION_READY = 2,
    /** Verification failed; it starts again every second. */
    IGH_MCAN_SESSION_FAILED = 3
} igh_mcan_session_t;

/** Kind of the TxPDO image of a cycle. */
typedef enum {
    /** The gateway is not ready. */
    IGH_MCAN_IMAGE_NONE = 0,
    /** A new image. */
    IGH_MCAN_IMAGE_NEW = 1,
    /** The image of an earlier cycle again. */
    IGH_MCAN_IMAGE_REPEATED = 2,
    /**
     * An image with a fault, usable up to the fault at most; see
     * igh_mcan_port_get_parse_diag().
     */
    IGH_MCAN_IMAGE_FAULT = 3
} igh_mcan_image_t;

/** One cycle with one gateway. */
typedef struct {
    /** Working counter and delivery. */
    ecan_igh_domain_report_t domain;
    /** An igh_mcan_image_t. */
    uint8_t image;
    /** 1 if the gateway marked the image as incomplete (manual 6.1). */
    uint8_t is_incomplete;
    /** 1 if the image's layout is not the configured one: its frames may be misread. */
    uint8_t layout_changed;
    /** 1 if the last RxPDO image is unconfirmed and is repeated; frames sent now wait. */
    uint8_t is_unconfirmed;
    /** Images lost before this one, by the sequence. */
    uint16_t lost_images;
    /** Zero; for fields of later versions. */
    uint16_t reserved[13];
} igh_mcan_cycle_report_t;

/**
 * Returns the state of a gateway's session.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  An igh_mcan_session_t; ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_session(igh_mcan_port_t *port, size_t slave);

/**
 * Gets the state of a gateway's session as text, with the reason of a failure and the pending step.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_BUFFER.
 */
int igh_mcan_port_get_session_text(igh_mcan_port_t *port,
                                   size_t slave,
                                   char *text,
                                   size_t size,
                                   size_t *needed);

/**
 * Gets a change of a gateway or channel that was not told yet, as a line: what was lost, why as far as it is
 * known, what returned and after how long, with the time since ecan_open() or ecan_igh_wait_op_timeout(). Call it
 * after each cycle until the text is empty.
 *
 * @param text  Empty if there is none. A call with size 0 leaves the change for the next call. See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_BUFFER for a line that is cut.
 */
int igh_mcan_port_next_change(igh_mcan_port_t *port,
                              char *text,
                              size_t size,
                              size_t *needed);

/**
 * Fails at the end of a program that sends if no frame was delivered, or if a channel is bus-off or rejects frames
 * while its condition is not good.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NOT_READY with the reason, as far as it is known.
 */
ECAN_MUST_CHECK
int igh_mcan_port_check_delivery(igh_mcan_port_t *port);

/**
 * Gets the report of the current cycle with a gateway.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_cycle_report(igh_mcan_port_t *port,
                                   size_t slave,
                                   igh_mcan_cycle_report_t *report);

/**
 * Gets the last fault in a TxPDO image (manual 16.2).
 *
 * @param diag  Gets the fault; error 0 for none.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_parse_diag(igh_mcan_port_t *port,
                                 size_t slave,
                                 igh_mcan_pdo_parse_diag_t *diag);

/**
 * Gets the status of a channel from the last TxPDO image (manual 7); all 0 before the first.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_channel_status(igh_mcan_port_t *port,
                                     size_t slave,
                                     uint8_t channel,
                                     igh_mcan_channel_status_t *status);

/* ---------------------------------------------------------------------------
 * Counters and capabilities
 *
 * Counters only grow, and wrap at 2^64. Each accepted frame is in exactly one column:
 * frames_accepted is the sum of frames_delivered, frames_lost, frames_discarded, frames_unknown and
 * frames_pending. Images read from the gateway since it was ready for the first time are
 * txpdo_received, txpdo_lost and txpdo_discarded, and at most txpdo_unknown more; the number of
 * frames in lost and unknown images cannot be known.
 * --------------------------------------------------------------------------- */

/** Counters of one gateway. */
typedef struct {
    /** Cycles since the gateway was ready for the first time. */
    uint64_t cycles;
    /** Cycles among them with an incomplete working counter. */
    uint64_t incomplete_cycles;
    /** RxPDO images published with a new sequence. */
    uint64_t rxpdo_published;
    /** Cycles in which an unconfirmed image was repeated. */
    uint64_t rxpdo_repeated;
    /** RxPDO images with frames that were withdrawn before their delivery was confirmed. */
    uint64_t rxpdo_discarded;
    /** TxPDO images with new content. */
    uint64_t txpdo_received;
    /** Cycles without a new TxPDO image. */
    uint64_t txpdo_repeated;
    /** Lost or damaged TxPDO images, by the gaps in the sequence. */
    uint64_t txpdo_lost;
    /** TxPDO images that were being written while they were read. */
    uint64_t txpdo_torn;
    /** TxPDO images that the gateway marked as incomplete: frames were delayed or lost. */
    uint64_t txpdo_incomplete;
    /** TxPDO images of another layout than the configured one. */
    uint64_t txpdo_layout_changes;
    /** TxPDO images or packets with a fault: bad CRC, bad header, bad packet. */
    uint64_t parse_errors;
    /** Transmit results without a matching frame. */
    uint64_t unmatched_results;
    /** Times that the gateway became ready. */
    uint64_t sessions;
    /** Times that the gateway was lost while ready; a loss during its verification is none. */
    uint64_t sessions_lost;
    /** Failed verifications. */
    uint64_t verification_failures;
    /**
     * TxPDO images that arrived while the gateway was not ready; their frames are not handed
     * out.
     */
    uint64_t txpdo_discarded;
    /**
     * Most TxPDO images that can have been lost in outages after which the gateway started its
     * sequence again.
     */
    uint64_t txpdo_unknown;
    /** Requests of another startup because the gateway stayed in one state below OP. */
    uint64_t startup_requests;
    /** Zero; for fields of later versions. */
    uint64_t reserved[9];
} igh_mcan_statistics_t;

/** Counters of one channel. */
typedef struct {
    /** Frames of RxPDO images that were published. */
    uint64_t frames_sent;
    /** Frames that the gateway took in OP. */
    uint64_t frames_delivered;
    /**
     * Frames that never left the host: discarded by the application or after a lost session, or
     * withdrawn because their phase had passed.
     */
    uint64_t frames_discarded;
    /** Frames received in TxPDO images. */
    uint64_t frames_received;
    /** Frames rejected because the image was full. */
    uint64_t rejected_image_full;
    /** Frames rejected because the gateway's transmit queue might overflow. */
    uint64_t rejected_queue_full;
    /** Frames rejected because the channel was bus-off. */
    uint64_t rejected_bus_off;
    /** Transmit results that reported success: code 0 or 1 (manual 10). */
    uint64_t results_ok;
    /** Transmit results that reported a failure. */
    uint64_t results_failed;
    /** Frames that a send accepted. */
    uint64_t frames_accepted;
    /** Frames of published images that the gateway certainly did not take. */
    uint64_t frames_lost;
    /**
     * Frames that the gateway may have taken: of images whose delivery is not known, or that it
     * may have taken outside OP.
     */
    uint64_t frames_unknown;
    /** Frames without a known result so far; not a counter. */
    uint64_t frames_pending;
    /**
     * Frames of images that the slave controller took, by the working counter: of those that are
     * delivered, pending or unknown.
     */
    uint64_t frames_confirmed;
    /**
     * Frames that arrived and that the application did not take: left in their cycle, or while
     * the gateway was not ready.
     */
    uint64_t frames_not_taken;
    /** Zero; for fields of later versions. */
    uint64_t reserved[9];
} igh_mcan_channel_statistics_t;

/** Capabilities of a gateway (0xF000, manual 13.8), read when the Port was opened. */
typedef struct {
    /** :07, :08 Serial number, 0 when not programmed. */
    uint64_t serial_number;
    /** :04 Hardware revision, 0 when not programmed. */
    uint32_t hardware_revision;
    /** :12 Bit n for encapsulation profile n. */
    uint32_t profile_mask;
    /** :16 Features. */
    uint32_t features;
    /** :19 Bit 0 FoE, bit 2 persistence, bit 4 access levels. */
    uint32_t service_flags;
    /** :24 Tests that 0x8030 offers. */
    uint32_t data_path_features;
    /** :25 The same. */
    uint32_t diagnostic_features;
    /** :26 Runtime options of 0x8020:05. */
    uint32_t runtime_option_mask;
    /** :27 Diagnostic options of 0x8020:06. */
    uint32_t diagnostic_option_mask;
    /** :03 Version of the object. */
    uint16_t capability_version;
    /** :05 Firmware version: high byte major, low byte minor. */
    uint16_t firmware_major;
    /** :06 Firmware build. */
    uint16_t firmware_minor;
    /** :09 Bit n for header version n. */
    uint16_t header_version_mask;
    /** :13 Maximum PDO size of a direction in bytes. */
    uint16_t max_pdo_bytes;
    /** :17 Bytes per N. */
    uint16_t size_unit_bytes;
    /** :18 Bytes of the fixed header. */
    uint16_t header_bytes;
    /** :20 Version of the object extensions. */
    uint16_t object_extension;
    /** :21 Version of the data path extensions. */
    uint16_t data_path_extension;
    /** :22 Version of the diagnostic extensions. */
    uint16_t diagnostic_extension;
    /** :28 Receive cache of a channel in frames. */
    uint16_t rx_cache_max;
    /** :29 Transmit cache of a channel in frames. */
    uint16_t tx_cache_max;
    /** :30 Upper limit of 0x8020:07 in microseconds. */
    uint16_t max_service_budget_us;
    /** :01 0 is ECAN-Lite, others are customised. */
    uint8_t device_type;
    /** :02 CAN channels. */
    uint8_t channel_count;
    /** :10 Minimum N. */
    uint8_t multiplier_min;
    /** :11 Maximum N. */
    uint8_t multiplier_max;
    /** :14 Maximum number of channels. */
    uint8_t max_channels;
    /** :15 Option flags that can be set. */
    uint8_t option_mask;
    /** Zero; for fields of later versions. */
    uint64_t reserved[7];
} igh_mcan_capabilities_t;

/**
 * Gets the counters of a gateway.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_statistics(igh_mcan_port_t *port,
                                 size_t slave,
                                 igh_mcan_statistics_t *statistics);

/**
 * Gets the counters of a channel.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_channel_statistics(igh_mcan_port_t *port,
                                         size_t slave,
                                         uint8_t channel,
                                         igh_mcan_channel_statistics_t *statistics);

/**
 * Gets the capabilities of a gateway.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_mcan_port_get_capabilities(igh_mcan_port_t *port,
                                   size_t slave,
                                   igh_mcan_capabilities_t *capabilities);

#ifdef __cplusplus
}
#endif

#endif /* IGH_MCAN_PORT_H */
