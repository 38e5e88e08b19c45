/**
 * ECAN-Lite host SDK: the MCAN Port (manual 15.1, 15.4, 15.5).
 *
 * CAN and CAN FD frames through ECAN-Lite gateways.
 *
 * The rules for all functions, and the change log of all headers, stand at the head of
 * igh_ecan_common.h.
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
 * Plain data: it may be copied and needs no end. igh_mcan_port_apply_config() hands it to the
 * Adapter's configuration, whose startup SDOs it then decides.
 * --------------------------------------------------------------------------- */

/** Most filters of a configuration, of all channels together. */
#define IGH_MCAN_MAX_FILTERS 512

/** What the Port is told about the gateways. About 40 kilobytes. */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[5120];
} igh_mcan_port_config_t;

/**
 * Fills a configuration: no channel enabled, encapsulation 0, no options, frames paced.
 *
 * @param config  Is overwritten, whatever it holds.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK or ECAN_ERR_NULL.
 */
int igh_mcan_port_default_config(igh_mcan_port_config_t *config);

/**
 * Hands a configuration to the Adapter's: ecan_igh_init() then writes PDO profiles, channel masks,
 * bit rates, filters and budgets as startup SDOs (manual 15.5.2, step 4). Is copied; call it again
 * after changing something. The gateways of the first slave_count slaves are taken.
 *
 * Without this call the gateways keep what they were told last; a Port then verifies that it is
 * what its own configuration says.
 *
 * @usage   not rt, any thread, before ecan_igh_init
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error(); ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED.
 */
int igh_mcan_port_apply_config(ecan_igh_config_t *igh_config, const igh_mcan_port_config_t *config);

/**
 * Checks a configuration as a whole against that of the Adapter. igh_mcan_port_apply_config() and
 * igh_mcan_port_init() do it, too.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_apply_config().
 */
int igh_mcan_port_check_config(const ecan_igh_config_t *igh_config,
                               const igh_mcan_port_config_t *config);

/* ---------------------------------------------------------------------------
 * Configuration of a channel (manual 13.4)
 * --------------------------------------------------------------------------- */

/**
 * Says which channels of a gateway are enabled, and which of them for CAN FD.
 *
 * A channel that was enabled keeps its settings as far as its kind stays; a new one gets 500
 * kbit/s, with CAN FD and 5 Mbit/s in the data phase.
 *
 * @param channel_mask  Channels to enable, bit 0 for channel 0.
 * @param canfd_mask    Those of them for CAN FD.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for
 *          channels beyond 3, or CAN FD without the channel.
 */
int igh_mcan_port_set_channel_mask(igh_mcan_port_config_t *config,
                                   size_t slave,
                                   uint8_t channel_mask,
                                   uint8_t canfd_mask);

/**
 * Gets which channels of a gateway are enabled, and which of them for CAN FD. Their bit rates are
 * objects 19 and 20 (igh_mcan_port_get_channel_object()).
 *
 * @param channel_mask  Gets the channels, bit 0 for channel 0.
 * @param canfd_mask    Gets those of them for CAN FD.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_channel_mask(const igh_mcan_port_config_t *config,
                                   size_t slave,
                                   uint8_t *channel_mask,
                                   uint8_t *canfd_mask);

/**
 * Enables a channel for classic CAN, with everything else at its default.
 *
 * @param bitrate  Bit/s.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 *          Whether the bit rate can be had is told by igh_mcan_port_apply_config().
 */
int igh_mcan_port_set_classic_channel(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t channel,
                                      uint32_t bitrate);

/**
 * Enables a channel for CAN FD with bit rate switch and transmitter delay compensation (manual
 * 14.3), with everything else at its default.
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
 * Sets the windows in which the firmware may choose the sample points; 75 to 87.5 % by default.
 *
 * @param nominal_min, nominal_max  Arbitration phase, in 0.1 %.
 * @param data_min, data_max        Data phase, in 0.1 %.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_set_sample_points(igh_mcan_port_config_t *config,
                                    size_t slave,
                                    uint8_t channel,
                                    uint16_t nominal_min,
                                    uint16_t nominal_max,
                                    uint16_t data_min,
                                    uint16_t data_max);

/**
 * Sets the traffic that budgets and Message RAM of a channel are made for (manual 13.2.2); 8 and 8
 * by default.
 *
 * @param received  Frames from the bus per cycle; at most 8 are drained.
 * @param sent      Frames to the bus per cycle; at most 8 are served.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_set_traffic(igh_mcan_port_config_t *config,
                              size_t slave,
                              uint8_t channel,
                              uint8_t received,
                              uint8_t sent);

/**
 * Sets any configuration object of a channel, 0x8001..0x8004, by the manual's (decimal) subindex:
 * bit timing mode (7), node mode (8), manual timing (25 to 32), delay compensation (16, 33, 34),
 * Message RAM, timestamps and all others of manual 13.4. Filters have functions of their own.
 *
 * @param subindex  7 and up.
 * @param value     As it would be written by SDO.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT for a subindex that is no configuration or a value that it
 *          does not have; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL.
 */
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
 * Sets any policy object of a channel's data path, 0x8021..0x8024, by the manual's (decimal)
 * subindex (13.2.2): budgets, caches, overflow and critical-frame policies, bus-off recovery.
 *
 * @param subindex  1, 4 to 19.
 * @param value     As it would be written by SDO.
 *
 * @usage   not rt, any thread, before apply
 * @return  As igh_mcan_port_set_channel_object().
 */
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

/* ---------------------------------------------------------------------------
 * Acceptance filters (manual 13.4)
 * --------------------------------------------------------------------------- */

/** Which identifiers a filter matches. */
typedef enum {
    /** From id1 to id2, both included; extended ones after the channel's global mask. */
    IGH_MCAN_MATCH_RANGE = 0,
    /** id1 and id2. */
    IGH_MCAN_MATCH_TWO = 1,
    /** Those that equal id1 in the bits set in id2. */
    IGH_MCAN_MATCH_MASKED = 2,
    /** Extended filters: from id1 to id2 without the global mask. Standard filters: none. */
    IGH_MCAN_MATCH_RANGE_UNMASKED = 3,
} igh_mcan_match_t;

/** What happens to a frame that a filter matches. */
typedef enum {
    /** The filter is out of use. */
    IGH_MCAN_FILTER_DISABLED = 0,
    /** Into RX FIFO 0. */
    IGH_MCAN_FILTER_FIFO0 = 1,
    /** Into RX FIFO 1. */
    IGH_MCAN_FILTER_FIFO1 = 2,
    /** Refused. */
    IGH_MCAN_FILTER_REJECT = 3,
    /** Marked as a priority message; it goes where later filters say. */
    IGH_MCAN_FILTER_PRIORITY = 4,
    /** Marked as a priority message, into RX FIFO 0. */
    IGH_MCAN_FILTER_PRIORITY_FIFO0 = 5,
    /** Marked as a priority message, into RX FIFO 1. */
    IGH_MCAN_FILTER_PRIORITY_FIFO1 = 6,
    /** Into the receive buffer whose number is id2; the filter means the one identifier id1. */
    IGH_MCAN_FILTER_BUFFER = 7,
} igh_mcan_filter_action_t;

/**
 * Adds a filter for 11-bit identifiers behind those that the channel has; at most 64.
 *
 * What no filter matches is accepted or refused by 0x8001:36 (igh_mcan_port_set_channel_object()).
 *
 * @param matching  An igh_mcan_match_t.
 * @param action    An igh_mcan_filter_action_t.
 * @param id1, id2  Identifiers, or identifier and mask.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL,
 *          ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond IGH_MCAN_MAX_FILTERS.
 */
int igh_mcan_port_add_standard_filter(igh_mcan_port_config_t *config,
                                      size_t slave,
                                      uint8_t channel,
                                      int matching,
                                      int action,
                                      uint16_t id1,
                                      uint16_t id2);

/**
 * Adds a filter for 29-bit identifiers; as igh_mcan_port_add_standard_filter(), at most 24.
 *
 * @usage   not rt, any thread, before apply
 * @return  As there.
 */
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
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_clear_filters(igh_mcan_port_config_t *config, size_t slave, uint8_t channel);

/* ---------------------------------------------------------------------------
 * Configuration of a gateway
 * --------------------------------------------------------------------------- */

/**
 * Sets how frames are packed: 0x8010:05 and 0x8011:05 (manual 9); 0 by default.
 *
 * @param tx_encapsulation  Of the TxPDO, slave to master: an igh_mcan_encapsulation_t. 1 and 5
 *                          bring timestamps.
 * @param rx_encapsulation  Of the RxPDO.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_encapsulation(igh_mcan_port_config_t *config,
                                    size_t slave,
                                    int tx_encapsulation,
                                    int rx_encapsulation);

/**
 * Sets how channels share the images: 0x8010:06 and 0x8011:06 (manual 12); balanced by default.
 *
 * @param tx_budget, rx_budget  An igh_mcan_budget_t each.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_budget(igh_mcan_port_config_t *config,
                             size_t slave,
                             int tx_budget,
                             int rx_budget);

/**
 * Sets the options of the images: 0x8010:07 and 0x8011:07 (manual 9.1); none by default.
 *
 * @param tx_options  IGH_MCAN_OPTION_ values; with _TX_RESULT every frame sent is reported on.
 * @param rx_options  IGH_MCAN_OPTION_ values but for _TX_RESULT.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_port_set_options(igh_mcan_port_config_t *config,
                              size_t slave,
                              uint8_t tx_options,
                              uint8_t rx_options);

/**
 * Says whether frames are refused that would overrun the gateway's transmit queue or meet a
 * channel that is bus-off; they are, by default. Otherwise the queue drops what it cannot hold.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_set_paced(igh_mcan_port_config_t *config, size_t slave, int paced);

/**
 * Sets when a gateway in service counts as lost: nothing is sent then until it has been verified
 * again.
 *
 * @param hold_limit   Images in a row that may miss it; 10 by default.
 * @param input_limit  Cycles in a row without a new TxPDO image; 100 by default, 0 for no limit.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_set_limits(igh_mcan_port_config_t *config,
                             size_t slave,
                             uint16_t hold_limit,
                             uint16_t input_limit);

/**
 * Permits the application bypass and the tests of 0x8030, which cut the CAN side off; a Port that
 * finds them active refuses to start otherwise.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_allow_diagnostic_tests(igh_mcan_port_config_t *config, size_t slave, int allow);

/* ---------------------------------------------------------------------------
 * Configuration from a file
 *
 * One TOML file describes the gateways of a bus: their places, PDO sizes, distributed clocks,
 * channels with bit rates, filters and policies. `ecan config example` prints one with every key;
 * `ecan config` also checks, compares and exports the file that an application loads.
 *
 * ecan_igh_default_config(&igh_config);
 * if (igh_mcan_port_load_config(&igh_config, &mcan_config, "cell.toml") != ECAN_OK) {
 *     fprintf(stderr, "%s\n", ecan_last_error());    every fault, with line and column
 * }
 * ecan_igh_init(&igh, &igh_config);
 * igh_mcan_port_init(&mcan, &igh, &mcan_config);
 * --------------------------------------------------------------------------- */

/** Bytes of the words of a fault, NUL included. */
#define IGH_MCAN_FILE_FAULT_BYTES 248

/** One thing that is wrong with a configuration file. */
typedef struct {
    /** Line, from 1. */
    uint32_t line;
    /** Column in characters, from 1. */
    uint32_t column;
    /** What is wrong, in UTF-8; cut where it does not fit. */
    char reason[IGH_MCAN_FILE_FAULT_BYTES];
} igh_mcan_file_fault_t;

/**
 * Loads the configurations of the Adapter and of the Port from a file. They are applied, as by
 * igh_mcan_port_apply_config(): ecan_igh_init() and igh_mcan_port_init() are all that is left.
 *
 * Everything that the file says reaches the gateways, and what it leaves out has the file's
 * defaults, whatever stood in the configurations. Other functions may change both afterwards;
 * changes of `config` have to be applied again.
 *
 * @param igh_config  Initialised. What a file has no word for stays: the library (setting `ecrt`),
 *                    scenario, clock and seed of a simulation. Everything else is replaced,
 *                    startup SDOs included. Policies of 0x8020 become startup SDOs, 6 for each
 *                    gateway that has any, and count for ECAN_IGH_MAX_STARTUP_SDOS.
 * @param config      Is overwritten, whatever it holds.
 * @param path        The file, as the system names it; a relative one counts from the working
 *                    directory.
 *
 * @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
 * @return  ECAN_OK; ECAN_ERR_FILE where it cannot be read; ECAN_ERR_CONFIG with every fault in
 *          ecan_last_error(), by line and column; ECAN_ERR_FULL for more than ECAN_IGH_MAX_SLAVES
 *          gateways or IGH_MCAN_MAX_FILTERS filters; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED. Both
 *          configurations stay as they were after an error.
 */
int igh_mcan_port_load_config(ecan_igh_config_t *igh_config,
                              igh_mcan_port_config_t *config,
                              const char *path);

/**
 * As igh_mcan_port_load_config(), with the faults as data, for an editor for example.
 * ecan_last_error() holds some eighty of them.
 *
 * @param faults    Gets as many of the file's faults as there is room for, in the order of its
 *                  lines; may be NULL where capacity is 0.
 * @param capacity  Room of `faults`.
 * @param count     Gets the number of all faults; 0 for every other error.
 *
 * @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
 * @return  As igh_mcan_port_load_config().
 */
int igh_mcan_port_load_config_ex(ecan_igh_config_t *igh_config,
                                 igh_mcan_port_config_t *config,
                                 const char *path,
                                 igh_mcan_file_fault_t *faults,
                                 size_t capacity,
                                 size_t *count);

/**
 * As igh_mcan_port_load_config_ex(), from a text that the application has in memory.
 *
 * @param text  What would stand in the file, up to a NUL.
 *
 * @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
 * @return  As igh_mcan_port_load_config(), but for ECAN_ERR_FILE.
 */
int igh_mcan_port_parse_config(ecan_igh_config_t *igh_config,
                               igh_mcan_port_config_t *config,
                               const char *text,
                               igh_mcan_file_fault_t *faults,
                               size_t capacity,
                               size_t *count);

/* ---------------------------------------------------------------------------
 * Preflight plan
 *
 * What configurations cost on wire, CAN buses, images and mailboxes, and what speaks against them,
 * before anything touches a bus.
 * --------------------------------------------------------------------------- */

/** Where frames of a plan go. */
typedef enum {
    /** From the host through the gateway to the bus. */
    IGH_MCAN_ROUTE_TO_BUS = 0,
    /** From the bus through the gateway to the host. */
    IGH_MCAN_ROUTE_FROM_BUS = 1,
    /** Between other nodes: it only takes bus time. */
    IGH_MCAN_ROUTE_ON_BUS_ONLY = 2,
} igh_mcan_frame_route_t;

/** Frames of one kind on one channel, for a plan. */
typedef struct {
    /**
     * One of them, made by igh_mcan_tx_frame_set_can() and the like; slave, channel, kind of
     * identifier, flags, length and schedule count.
     */
    igh_mcan_tx_frame_t frame;
    /** So many frames ... */
    uint32_t frames;
    /** ... in so many cycles; 0 counts as 1. More than one frame needs 1. */
    uint32_t cycles;
    /** An igh_mcan_frame_route_t. */
    uint8_t way;
    /** Not used. */
    uint8_t reserved[3];
} igh_mcan_frame_stream_t;

/**
 * Plans configurations for a traffic.
 *
 * @param streams  The frames; may be NULL where count is 0.
 * @param text     Gets the plan as a table with its warnings; cut where it does not fit. 4096
 *                 bytes are enough for a few gateways.
 * @param size     Bytes of the text, NUL included; 0 asks for none.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK, also with warnings; ECAN_ERR_CONFIG where something would not work, with
 *          everything in ecan_last_error(); ECAN_ERR_ARGUMENT, ECAN_ERR_FRAME for a stream;
 *          ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
 */
int igh_mcan_port_plan(const ecan_igh_config_t *igh_config,
                       const igh_mcan_port_config_t *config,
                       const igh_mcan_frame_stream_t *streams,
                       size_t count,
                       char *text,
                       size_t size);

/* ---------------------------------------------------------------------------
 * Life of a Port
 * --------------------------------------------------------------------------- */

/**
 * CAN and CAN FD through the gateways of one master. Belongs to the thread of the cycle and stays
 * where it is: a copy names nothing. Ends with its ecan_igh_context_t at the latest.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} igh_mcan_port_t;

/**
 * Puts a Port on a master that is not active yet. ecan_igh_wait_op_timeout() then brings the
 * gateways into service.
 *
 * @param port    Whatever it holds; the manual's fragments leave it uninitialised.
 * @param igh     The master. Must stay where it is as long as the Port is used.
 * @param config  The one that was given to igh_mcan_port_apply_config(). Is copied.
 *
 * @usage   not rt, the cycle's thread, after ecan_igh_init and before the bus is active
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault, or for another configuration than the one
 *          that was applied; ECAN_ERR_ORDER where there is a Port already or the bus is active;
 *          ECAN_ERR_SDO, ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY. The master stays as it is after an error.
 */
int igh_mcan_port_init(igh_mcan_port_t *port,
                       ecan_igh_context_t *igh,
                       const igh_mcan_port_config_t *config);

/**
 * Takes the gateways out of service and configures them anew: the way to switch N or channels at
 * run time (manual 14.2). Then wait for OP again. Frames not delivered are lost, statistics start
 * anew, axes on it end.
 *
 * @param igh_config  Of the Adapter; the Port's part of it is `config`.
 * @param config      Of the gateways.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  As ecan_igh_init(); a faulty configuration changes nothing. After any other error
 *          another reconfigure may be tried. ECAN_ERR_ATTACHED, ECAN_ERR_BUSY.
 */
int igh_mcan_port_reconfigure(igh_mcan_port_t *port,
                              const ecan_igh_config_t *igh_config,
                              const igh_mcan_port_config_t *config);

/**
 * Whether every gateway is in service: in OP and verified.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY. Compare with 1.
 */
int igh_mcan_port_is_ready(igh_mcan_port_t *port);

/**
 * Takes the Port off the master, which stays active. Axes on it end.
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also for a Port that ended already or never was; ECAN_ERR_NULL,
 *          ECAN_ERR_BUSY.
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
 * Sleeps until the next cycle is due; as ecan_igh_wait_next_cycle().
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_mcan_port_wait_next_cycle(igh_mcan_port_t *port);

/**
 * First in the cycle: fetches the images, judges them, and goes on with bringing gateways into
 * service. What the last cycle brought and was not received is gone. Does nothing while a cycle
 * is open already. Keep the words of an error if they matter: a frame that is refused later in the
 * cycle has others.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_MASTER where a call of the library failed: the cycle is open all the
 *          same, call igh_mcan_port_cycle_end() in any case. ECAN_ERR_ORDER where the bus is not
 *          active; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_mcan_port_cycle_begin(igh_mcan_port_t *port);

/**
 * Last in the cycle: publishes the images, or held ones once more, and sends.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_MASTER where a call of the library failed, and the cycle may go on
 *          with the next call; ECAN_ERR_ORDER where the bus is not active; ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_mcan_port_cycle_end(igh_mcan_port_t *port);

/**
 * Takes what came back: frames of the buses, and the outcome of frames sent where the option
 * TX_RESULT is set (kind). In the order of the images and of the slaves. What does not fit stays
 * for another call in the same cycle.
 *
 * @param rx        Room for frames.
 * @param capacity  Frames that fit.
 * @param rx_count  Gets the number of frames taken.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY.
 */
int igh_mcan_port_receive(igh_mcan_port_t *port,
                          igh_mcan_rx_frame_t *rx,
                          size_t capacity,
                          size_t *rx_count);

/* ---------------------------------------------------------------------------
 * Sending
 *
 * A packet is written once, straight into the process image. A frame that is not taken leaves no
 * trace; for some codes it may be sent again in a later cycle (ecan_result_is_temporary()).
 * --------------------------------------------------------------------------- */

/** Where a frame went; igh_mcan_rx_frame_t of kind IGH_MCAN_RX_TX_RESULT names the same. */
typedef struct {
    /** Slave index. */
    uint16_t slave;
    /** Sequence of the image. */
    uint16_t sequence;
    /** Place of the frame among the frames of the image, from 0. */
    uint8_t frame_index;
    /** Not used. */
    uint8_t reserved[3];
} igh_mcan_ticket_t;

/**
 * Sends a classic CAN frame.
 *
 * @param slave    Slave index.
 * @param channel  Channel of the gateway, 0 to 3.
 * @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
 * @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
 * @param data     Data; may be NULL where len is 0 and for a remote frame.
 * @param len      Bytes, 0 to 8; of a remote frame the DLC that it asks for.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_NO_ROOM, ECAN_ERR_QUEUE_FULL, ECAN_ERR_BUS_OFF, ECAN_ERR_NOT_READY:
 *          not now; ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_FRAME; ECAN_ERR_ORDER where no
 *          cycle is open; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
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
 *               understood.
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
 * distributed clocks. A frame that reaches the gateway behind its phase is dropped there.
 *
 * @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
 * @param tag        Mark of the application.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_mcan_port_send_can(); ECAN_ERR_SCHEDULE where it cannot be scheduled.
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
 * @return  As igh_mcan_port_send_canfd(); ECAN_ERR_SCHEDULE where it cannot be scheduled.
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
 * Sends a frame that was made by igh_mcan_tx_frame_set_can() and the like.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As the functions above; ECAN_ERR_ARGUMENT for an unknown hint.
 */
int igh_mcan_port_send(igh_mcan_port_t *port, const igh_mcan_tx_frame_t *frame);

/**
 * Sends frames in order and stops at the first that is not taken, so that the order holds when the
 * rest is sent in a later cycle.
 *
 * @param sent  Gets the number of frames taken, from the front.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK where all were taken; otherwise why the next one was not, as
 *          igh_mcan_port_send().
 */
int igh_mcan_port_send_batch(igh_mcan_port_t *port,
                             const igh_mcan_tx_frame_t *frames,
                             size_t count,
                             size_t *sent);

/**
 * One whole cycle, for bring-up and test scripts: begin, receive, send, end. Keeping the period is
 * up to the caller.
 *
 * @param tx        Frames to send; may be NULL where tx_count is 0.
 * @param rx        Room for what came back.
 * @param rx_count  Gets the number of frames taken.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK where all frames were taken; otherwise the first thing that went wrong, as the
 *          functions that it stands for. The cycle is whole in any case.
 */
int igh_mcan_port_exchange(igh_mcan_port_t *port,
                           const igh_mcan_tx_frame_t *tx,
                           size_t tx_count,
                           igh_mcan_rx_frame_t *rx,
                           size_t capacity,
                           size_t *rx_count);

/**
 * Where the frame went that was sent last. Ask behind the send whose TX_RESULT is of interest.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ORDER where nothing was sent yet; ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_mcan_port_get_last_ticket(igh_mcan_port_t *port, igh_mcan_ticket_t *ticket);

/**
 * Bytes left in the image of this cycle; a packet needs 4 to 78 of them (manual 8.3).
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The bytes; 0 where there is no such gateway.
 */
size_t igh_mcan_port_image_room(igh_mcan_port_t *port, size_t slave);

/**
 * Gives up every frame that is not known to have reached the gateway. Frames of an image that is
 * held may have been executed all the same.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number of frames given up, 0 or more; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_discard_pending(igh_mcan_port_t *port, size_t slave);

/* ---------------------------------------------------------------------------
 * Scheduled transmission
 *
 * Frames sent at a phase of Sync0 (manual 8.4, 13.8, 13.9): the time that they have to get there,
 * and what became of them, as far as the gateway tells. igh_mcan_port_schedule_can() and its like
 * send them.
 * --------------------------------------------------------------------------- */

/** Flag of 0xB000:06: a scheduled frame was dropped since its phase had passed. */
#define IGH_MCAN_SCHEDULE_LATE_DROP 64

/** Flag of 0xB000:06: a scheduled frame found the queue full. */
#define IGH_MCAN_SCHEDULE_QUEUE_FULL 128

/** Flag of 0xB000:06: a scheduled frame was refused by the CAN controller at its phase. */
#define IGH_MCAN_SCHEDULE_TX_FAIL 256

/** Flag of 0xB000:06: the timer missed a phase. */
#define IGH_MCAN_SCHEDULE_TIMER_MISS 512

/**
 * The times that the margin of a schedule is reckoned with, and what is done without margin.
 * The manual gives no times; docs/ASSUMPTIONS.md says where the defaults come from.
 */
typedef struct {
    /** Latest time behind the point of the grid at which the cycle is sent, in nanoseconds. */
    uint32_t latest_send_ns;
    /**
     * Way of an image through host and network card, in nanoseconds, beside its time on the
     * wire.
     */
    uint32_t transport_ns;
    /** What the firmware needs until a frame waits for its phase, in nanoseconds. */
    uint32_t processing_ns;
    /**
     * Interval at which the gateway's diagnostics are read once a frame was scheduled, in
     * milliseconds; 0 never reads them.
     */
    uint32_t watch_ms;
    /** 1 refuses frames without margin; 0 sends and counts them. */
    uint8_t refuse_without_margin;
    /**
     * 1 gives up an image of scheduled frames only that may not have arrived, since published
     * again they could leave a period late.
     */
    uint8_t give_up_missed;
    /** Not used. */
    uint8_t reserved[2];
} igh_mcan_schedule_settings_t;

/**
 * Times around the Sync0 pulse that the offset of a scheduled frame counts from, in
 * nanoseconds from the point of the cycle's grid.
 */
typedef struct {
    /** Earliest arrival of the image in the gateway. */
    uint64_t earliest_arrival_ns;
    /** Latest arrival of the image in the gateway. */
    uint64_t latest_arrival_ns;
    /** The pulse that the offset counts from. */
    uint64_t pulse_ns;
    /** The phase at which the frame leaves. */
    uint64_t release_ns;
    /** From the pulse before to the earliest arrival. */
    int64_t after_pulse_ns;
    /** From the latest arrival to the pulse; negative where the pulse falls among the arrivals. */
    int64_t before_pulse_ns;
    /** From the end of the firmware's work to the phase; negative where frames may be dropped. */
    int64_t before_release_ns;
    /** The least of the three: what there is to spare. */
    int64_t least_ns;
} igh_mcan_schedule_margin_t;

/**
 * What became of a channel's scheduled frames. `scheduled` is the sum of `sent` to `open`; all
 * but `open` only grow.
 */
typedef struct {
    /** Frames that were taken. */
    uint64_t scheduled;
    /**
     * Frames that the gateway took and, by its flags, handed to the CAN controller at their
     * phase.
     */
    uint64_t sent;
    /** Frames that the gateway dropped since they came behind their phase. Needs TX_RESULT. */
    uint64_t late_dropped;
    /** Frames that found the gateway's schedule full. Needs TX_RESULT. */
    uint64_t queue_full;
    /** Frames that the gateway did not take for another reason. Needs TX_RESULT. */
    uint64_t not_sent;
    /**
     * Frames that never left the host: discarded, or taken back since the cycle ended too
     * late.
     */
    uint64_t withdrawn;
    /**
     * Frames of which it cannot be told, among them those of an image that was published
     * again, a period late.
     */
    uint64_t unknown;
    /** Frames of which it is not told yet. */
    uint64_t open;
    /** Frames that were refused since their cycle had begun too late for the phase. */
    uint64_t refused_late;
    /** Frames among `scheduled` that were taken without margin. */
    uint64_t without_margin;
} igh_mcan_schedule_account_t;

/** Counters of one channel, 0x9020 to 0x9023 (manual 13.2.5). */
typedef struct {
    /** :11 Times that the controller's FIFO was full. */
    uint32_t fifo_full;
    /** :12 Frames dropped as stale. */
    uint32_t stale_drops;
    /** :13 Times that the channel went off the bus. */
    uint32_t bus_offs;
} igh_mcan_channel_drops_t;

/** What a gateway tells of its scheduled transmission. */
typedef struct {
    /** When the reading ended, on the clock of ecan_igh_now_ns(). */
    uint64_t read_at_ns;
    /** Per channel; all 0 for one that is not enabled. */
    igh_mcan_channel_drops_t channels[ECAN_MCAN_CHANNELS];
    /** 0x9011:02 Sync0 pulses counted. */
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
    /** Not used. */
    uint8_t reserved[6];
} igh_mcan_schedule_diagnostics_t;

/**
 * Fills the settings with their defaults.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_NULL.
 */
int igh_mcan_port_default_schedule(igh_mcan_schedule_settings_t *settings);

/**
 * Sets them for a gateway.
 *
 * @usage   not rt, any thread, before apply
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_set_schedule(igh_mcan_port_config_t *config,
                               size_t slave,
                               const igh_mcan_schedule_settings_t *settings);

/**
 * The margin that an offset has against cycle, wire and firmware.
 *
 * @param offset_ns  Behind Sync0, in nanoseconds.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, whatever the margin is; ECAN_ERR_SCHEDULE for an offset that cannot be
 *          scheduled at all; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY,
 *          ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_schedule_margin(igh_mcan_port_t *port,
                                      size_t slave,
                                      uint32_t offset_ns,
                                      igh_mcan_schedule_margin_t *margin);

/**
 * What became of a channel's scheduled frames.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_get_schedule_account(igh_mcan_port_t *port,
                                       size_t slave,
                                       uint8_t channel,
                                       igh_mcan_schedule_account_t *account);

/**
 * The last look at what the gateway tells of scheduled transmission.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NOT_READY before the first look of this session; ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_schedule_diagnostics(igh_mcan_port_t *port,
                                           size_t slave,
                                           igh_mcan_schedule_diagnostics_t *diagnostics);

/**
 * Has the gateway clear the flags of 0xB000:06, and with them its other runtime diagnostics, in
 * the cycles to come (manual 13.7, bit 5).
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_clear_schedule_flags(igh_mcan_port_t *port, size_t slave);

/* ---------------------------------------------------------------------------
 * State of gateways and channels
 * --------------------------------------------------------------------------- */

/** Where a gateway's session stands. */
typedef enum {
    /** The slave is not in OP, or its process data do not arrive. */
    IGH_MCAN_SESSION_WAITING = 0,
    /** In OP, being verified; only empty images go out. */
    IGH_MCAN_SESSION_VERIFYING = 1,
    /** In service. */
    IGH_MCAN_SESSION_READY = 2,
    /** Verification failed; it starts over every second. */
    IGH_MCAN_SESSION_FAILED = 3,
} igh_mcan_session_t;

/** What became of the TxPDO image of a cycle. */
typedef enum {
    /** The gateway is not in service. */
    IGH_MCAN_IMAGE_NONE = 0,
    /** A new image. */
    IGH_MCAN_IMAGE_NEW = 1,
    /** The image of an earlier cycle again: nothing new arrived. */
    IGH_MCAN_IMAGE_REPEATED = 2,
    /** An image that cannot be used, or only up to the fault; see igh_mcan_port_get_parse_diag(). */
    IGH_MCAN_IMAGE_FAULT = 3,
} igh_mcan_image_t;

/** One cycle with one gateway. */
typedef struct {
    /** The working counter and what it tells. */
    ecan_igh_domain_report_t domain;
    /** An igh_mcan_image_t. */
    uint8_t image;
    /** 1 where the gateway marked the image as incomplete (manual 6.1). */
    uint8_t is_incomplete;
    /** 1 where the image's layout is not the configured one: its frames may be misread. */
    uint8_t layout_changed;
    /**
     * 1 where the last RxPDO image may not have arrived and is published again; frames sent now
     * wait.
     */
    uint8_t is_holding;
    /** Images that were lost before this one, by the sequence. */
    uint16_t lost_images;
    /** Not used. */
    uint16_t reserved;
} igh_mcan_cycle_report_t;

/**
 * Where a gateway's session stands.
 *
 * @param text  Gets the same in words, with the reason of a failure and what is waited for; may be
 *              NULL.
 * @param size  Bytes of the buffer; what does not fit is cut.
 *
 * @usage   rt with text NULL, the cycle's thread, after init
 * @return  An igh_mcan_session_t; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY,
 *          ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_session(igh_mcan_port_t *port, size_t slave, char *text, size_t size);

/**
 * What the current cycle brought from a gateway.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_cycle_report(igh_mcan_port_t *port,
                                   size_t slave,
                                   igh_mcan_cycle_report_t *report);

/**
 * The last fault in a TxPDO image (manual 16.2).
 *
 * @param diag  Gets it; error 0 where there was none.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_parse_diag(igh_mcan_port_t *port,
                                 size_t slave,
                                 igh_mcan_pdo_parse_diag_t *diag);

/**
 * Status of a channel from the last TxPDO image (manual 7); all 0 before the first.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_get_channel_status(igh_mcan_port_t *port,
                                     size_t slave,
                                     uint8_t channel,
                                     igh_mcan_channel_status_t *status);

/* ---------------------------------------------------------------------------
 * Counters and capabilities
 *
 * Counters only grow, and wrap at 2^64.
 * --------------------------------------------------------------------------- */

/** Counters of one gateway. */
typedef struct {
    /** Cycles run since the gateway was in service for the first time. */
    uint64_t cycles;
    /** Those of them whose working counter was not complete. */
    uint64_t incomplete_cycles;
    /** RxPDO images published with a new sequence. */
    uint64_t rxpdo_published;
    /** Cycles in which an image was published again because it may not have arrived. */
    uint64_t rxpdo_repeated;
    /** RxPDO images with frames that were given up. */
    uint64_t rxpdo_discarded;
    /** TxPDO images with new content. */
    uint64_t txpdo_received;
    /** Cycles that brought no new TxPDO image. */
    uint64_t txpdo_repeated;
    /** TxPDO images that never arrived, by the gaps in the sequence. */
    uint64_t txpdo_lost;
    /** TxPDO images that were being written while they were read. */
    uint64_t txpdo_torn;
    /** TxPDO images that the gateway marked as incomplete: frames stayed behind or were lost. */
    uint64_t txpdo_incomplete;
    /** TxPDO images of another layout than the configured one. */
    uint64_t txpdo_layout_changes;
    /** TxPDO images or packets with a fault: bad CRC, bad header, bad packet. */
    uint64_t parse_errors;
    /** Transmit results that match no send. */
    uint64_t unmatched_results;
    /** Times that the gateway was verified and taken into service. */
    uint64_t sessions;
    /** Times that the gateway was lost while in service. */
    uint64_t sessions_lost;
    /** Verifications that failed. */
    uint64_t verification_failures;
} igh_mcan_statistics_t;

/** Counters of one channel. */
typedef struct {
    /** Frames of RxPDO images that were published. */
    uint64_t frames_sent;
    /** Frames of images that the gateway took. */
    uint64_t frames_delivered;
    /** Frames of images that were given up, by the application or after a lost session. */
    uint64_t frames_discarded;
    /** Frames taken out of TxPDO images. */
    uint64_t frames_received;
    /** Frames refused because the image was full. */
    uint64_t refused_image_full;
    /** Frames refused because the gateway's transmit queue might not hold them. */
    uint64_t refused_queue_full;
    /** Frames refused because the channel is bus-off. */
    uint64_t refused_bus_off;
    /** Transmit results that reported success: code 0 or 1 (manual 10). */
    uint64_t results_ok;
    /** Transmit results that reported a failure. */
    uint64_t results_failed;
} igh_mcan_channel_statistics_t;

/** What a gateway can do (0xF000, manual 13.8), read when the Port was made. */
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
    /** :13 Greatest PDO of a direction in bytes. */
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
    /** :10 Smallest N. */
    uint8_t multiplier_min;
    /** :11 Greatest N. */
    uint8_t multiplier_max;
    /** :14 Greatest number of channels. */
    uint8_t max_channels;
    /** :15 Option flags that can be set. */
    uint8_t option_mask;
} igh_mcan_capabilities_t;

/**
 * Counters of a gateway.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_statistics(igh_mcan_port_t *port,
                                 size_t slave,
                                 igh_mcan_statistics_t *statistics);

/**
 * Counters of a channel.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL.
 */
int igh_mcan_port_get_channel_statistics(igh_mcan_port_t *port,
                                         size_t slave,
                                         uint8_t channel,
                                         igh_mcan_channel_statistics_t *statistics);

/**
 * What a gateway can do.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
 */
int igh_mcan_port_get_capabilities(igh_mcan_port_t *port,
                                   size_t slave,
                                   igh_mcan_capabilities_t *capabilities);

#ifdef __cplusplus
}
#endif

#endif /* IGH_MCAN_PORT_H */
