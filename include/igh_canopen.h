/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: CANopen networks (CiA 301, CiA 302-2, CiA 305).
 *
 * Nodes from a configuration file, their boot-up, and services for any node.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  First version.
 */
#ifndef IGH_CANOPEN_H
#define IGH_CANOPEN_H

#include "igh_cia402_protocol.h"
#include "igh_ecan_common.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Nodes of a network
 *
 * The network of a context (igh_cia402_context_t) has the drives of its axes, in the order of the axis
 * table, then the other nodes of the file of igh_cia402_context_init_file(), then those that
 * igh_canopen_add_node() adds. `node` is the index of a node in this order, from 0. A drive with several
 * axes is one node: `node` is not the index of an axis then, igh_canopen_find_node() returns it.
 *
 * The process data of nodes without an axis belong to the application: it reads their TPDOs by
 * igh_cia402_process_rx_ex() and sends their RPDOs by igh_mcan_port_send_can(), before
 * igh_cia402_send_targets_all(), which sends SYNC.
 *
 * igh_mcan_port_load_config(&igh_config, &mcan_config, "machine.toml", NULL, 0, NULL);
 * ...                                              ecan_igh_init, igh_mcan_port_init, OP
 * igh_cia402_context_init_file(&motors, &mcan, "machine.toml", NULL);
 * if (igh_canopen_wait_booted_timeout(&motors, 30000) != ECAN_OK) puts(ecan_last_error());
 * igh_cia402_start_up_timeout(&motors, 30000);
 * --------------------------------------------------------------------------- */

/** State of a CANopen node. */
typedef struct {
    /** Boot-up messages. */
    uint32_t boot_ups;
    /** Timeouts of its heartbeat or of node guarding. */
    uint32_t heartbeat_timeouts;
    /** Responses of node guarding whose toggle bit did not alternate. */
    uint32_t guard_toggle_errors;
    /** Responses of node guarding with another NMT state than the last command leads to. */
    uint32_t guard_state_errors;
    /** Emergency messages. */
    uint32_t emergencies;
    /** Error code of the last emergency message; 0 for none, or after the node reset it. */
    uint16_t error_code;
    /** Slave index of the gateway. */
    uint16_t slave;
    /** Channel of the gateway. */
    uint8_t channel;
    /** Node-ID. */
    uint8_t node_id;
    /** An igh_canopen_nmt_state_t: the last one that the node reported. */
    uint8_t nmt_state;
    /**
     * An igh_canopen_nmt_state_t to which the last boot-up message or command leads: the only
     * information about a node without heartbeat.
     */
    uint8_t expected_nmt_state;
    /** An igh_canopen_heartbeat_t: of its heartbeat, or of node guarding. */
    uint8_t heartbeat;
    /** An igh_canopen_boot_phase_t. */
    uint8_t boot_phase;
    /** Zero; for fields of later versions. */
    uint8_t reserved[34];
} igh_canopen_node_state_t;

/**
 * Returns the number of nodes of the network, drives included.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number; 0 if there is no context.
 */
size_t igh_canopen_node_count(igh_cia402_context_t *context);

/**
 * Finds a node by its address.
 *
 * @param slave    Slave index of the gateway.
 * @param channel  Channel of the gateway, 0 to 3.
 * @param node_id  Node-ID, 1 to 127.
 * @param node     Gets the node.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NODE if the network has no such node; ECAN_ERR_ARGUMENT.
 */
int igh_canopen_find_node(igh_cia402_context_t *context,
                          size_t slave,
                          uint8_t channel,
                          uint8_t node_id,
                          size_t *node);

/**
 * Adds a node that is neither in the axis table nor in the file, for SDO transfers, NMT, guarding and
 * emergency messages. It does not boot. Its channel gets SYNC and the host's heartbeat from then on.
 *
 * @param slave    Slave index of the gateway.
 * @param channel  Channel of the gateway, 0 to 3, enabled.
 * @param node_id  Node-ID, 1 to 127.
 * @param node     Gets the node; may be NULL.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_CONFIG if the network has the node already, or the host has its
 *          node-ID; ECAN_ERR_ARGUMENT.
 */
int igh_canopen_add_node(igh_cia402_context_t *context,
                         size_t slave,
                         uint8_t channel,
                         uint8_t node_id,
                         size_t *node);

/**
 * Gets the state of a node.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NODE.
 */
int igh_canopen_get_node_state(igh_cia402_context_t *context,
                               size_t node,
                               igh_canopen_node_state_t *node_state);

/**
 * Sends an NMT command to a node, with the next targets. A drive with an axis gets it by
 * igh_cia402_send_nmt(), too.
 *
 * @param command  An igh_canopen_nmt_t.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_CANOPEN if the command queue is full; ECAN_ERR_ARGUMENT, ECAN_ERR_NODE.
 */
int igh_canopen_send_nmt(igh_cia402_context_t *context,
                         size_t node,
                         int command);

/* ---------------------------------------------------------------------------
 * Boot-up of nodes
 *
 * The nodes of a file that have no axis boot as CiA 302-2 specifies: reset, response, identity, default
 * parameters, parameters with readback, PDOs, heartbeat, start. All nodes of all channels boot in parallel,
 * from the first cycle on; the cycle executes the boot-ups. A node that fails does not stop the others.
 * A node that restarts, or is replaced, boots again automatically.
 * --------------------------------------------------------------------------- */

/** In place of a node in igh_canopen_boot_again(): all nodes that boot. */
#define IGH_CANOPEN_ALL_NODES 4294967295

/** State of the boot-up of all nodes. */
typedef enum {
    /** A mandatory node is not booted yet. */
    IGH_CANOPEN_BOOT_RUNNING = 0,
    /**
     * All mandatory nodes are booted, also without any. Optional nodes may still boot, or have
     * failed.
     */
    IGH_CANOPEN_BOOT_DONE = 1,
    /** A mandatory node failed. */
    IGH_CANOPEN_BOOT_FAILED = 2
} igh_canopen_boot_state_t;

/** Phase of the boot-up of a node. */
typedef enum {
    /** The node does not boot: its axis configures it, or the node was added without a boot-up. */
    IGH_CANOPEN_BOOT_PHASE_NONE = 0,
    /** Nodes that boot before are not booted yet. */
    IGH_CANOPEN_BOOT_PHASE_WAITING = 1,
    /** The node has not responded yet. */
    IGH_CANOPEN_BOOT_PHASE_CONTACT = 2,
    /** Device type, identity and software are compared. */
    IGH_CANOPEN_BOOT_PHASE_IDENTITY = 3,
    /** The default parameters are restored. */
    IGH_CANOPEN_BOOT_PHASE_RESTORE = 4,
    /** Parameters are written and read back. */
    IGH_CANOPEN_BOOT_PHASE_PARAMETERS = 5,
    /** PDOs are mapped. */
    IGH_CANOPEN_BOOT_PHASE_PDOS = 6,
    /** The heartbeat is configured, and the node started. */
    IGH_CANOPEN_BOOT_PHASE_START = 7,
    /** The node has its parameters and runs as configured. */
    IGH_CANOPEN_BOOT_PHASE_BOOTED = 8,
    /** The boot-up of the node failed; see `status` and igh_canopen_get_boot_text(). */
    IGH_CANOPEN_BOOT_PHASE_FAILED = 9
} igh_canopen_boot_phase_t;

/** Progress of the boot-up of a node. */
typedef struct {
    /** Time since the boot-up began, or its duration if it has ended, in milliseconds. */
    uint64_t elapsed_ms;
    /** Written parameters. */
    uint32_t done;
    /** Parameters to write. */
    uint32_t of;
    /** Boot-ups after a restart of the node. */
    uint32_t restarts;
    /** Object whose transfer is in progress; 0 for none. */
    uint16_t index;
    /** Its subindex. */
    uint8_t subindex;
    /** An igh_canopen_boot_phase_t. */
    uint8_t phase;
    /**
     * Error status of CiA 302-2, a letter from 'A' to 'O'; 0 while there is none. 'B': no
     * response; 'C', 'D', 'M', 'N', 'O': device type, vendor-ID, product code, revision number,
     * serial number; 'H': software; 'J': parameters or PDOs; 'K': start.
     */
    uint8_t status;
    /** 1 if the network is booted only with this node. */
    uint8_t is_mandatory;
    /** 1 if the node had its parameters already, by its configuration date 0x1020. */
    uint8_t is_unchanged;
    /** Zero; for fields of later versions. */
    uint8_t reserved[37];
} igh_canopen_boot_progress_t;

/**
 * Gets the state of the boot-up of all nodes.
 *
 * @param boot_state  Gets an igh_canopen_boot_state_t.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_canopen_get_boot_state(igh_cia402_context_t *context, uint8_t *boot_state);

/**
 * Gets the progress of the boot-up of a node. One that does not boot has the phase
 * IGH_CANOPEN_BOOT_PHASE_NONE and zeros.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NODE.
 */
int igh_canopen_get_boot_progress(igh_cia402_context_t *context,
                                  size_t node,
                                  igh_canopen_boot_progress_t *progress);

/**
 * Gets the progress of the boot-up of a node as text, with the cause of a failure: "gripper, node 4
 * (slave 0, channel 1): writing parameters, 3 of 17, 0x6081:00 (Profile velocity), for 12 ms" for
 * example. Empty for a node that does not boot.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_BUFFER, ECAN_ERR_NODE.
 */
int igh_canopen_get_boot_text(igh_cia402_context_t *context,
                              size_t node,
                              char *text,
                              size_t size,
                              size_t *needed);

/**
 * Sets a function to which igh_canopen_wait_booted_timeout() reports the progress of the nodes: at its
 * start, and on every change of a phase. It runs inside this call, between two cycles; a call to the
 * library with this context returns ECAN_ERR_BUSY there.
 *
 * @param callback  Gets `user`, the node, and the text of igh_canopen_get_boot_text(), which is valid
 *                  until it returns; NULL for none. It must return, as that of
 *                  ecan_igh_stop_waiting_when().
 * @param user      Is passed to it.
 *
 * @usage   not rt, the cycle's thread, after init
 */
int igh_canopen_set_boot_callback(igh_cia402_context_t *context,
                                  void (*callback)(void *user, size_t node, const char *text),
                                  void *user);

/**
 * Waits until all mandatory nodes are booted. Runs the cycle, with the axes at their last targets. If a
 * node fails, it waits for the end of the other boot-ups of mandatory nodes.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_BOOT, where ecan_last_error() names each mandatory node that is not
 *          booted, with its phase or the cause; ECAN_ERR_ATTACHED on a master of another owner, use
 *          igh_canopen_get_boot_state() there; ECAN_ERR_ORDER if the bus is not active;
 *          ECAN_ERR_STOPPED, ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int igh_canopen_wait_booted_timeout(igh_cia402_context_t *context,
                                    uint32_t timeout_ms);

/**
 * Boots a node again, with its configured reset: after a change of its parameters by hand, for
 * example. A node that failed boots again automatically only after its boot-up message.
 *
 * @param node  The node, or IGH_CANOPEN_ALL_NODES.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NODE; ECAN_ERR_ORDER for a node that does not boot.
 */
int igh_canopen_boot_again(igh_cia402_context_t *context, size_t node);

/* ---------------------------------------------------------------------------
 * SDO transfers with nodes in the cycle
 *
 * For every node of the network. A node has one SDO server: while it boots, or its axis is configured,
 * changes its mode or is homing, a transfer of the application waits. igh_canopen_sdo_upload() and
 * igh_canopen_sdo_download() also wait for the end.
 * --------------------------------------------------------------------------- */

/**
 * Starts reading an object of a node; igh_canopen_sdo_poll() gets the result in later cycles.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the node is in progress;
 *          ECAN_ERR_NODE.
 */
ECAN_MUST_CHECK
int igh_canopen_sdo_start_upload(igh_cia402_context_t *context,
                                 size_t node,
                                 uint16_t index,
                                 uint8_t subindex);

/**
 * Starts writing an object of a node, as igh_canopen_sdo_start_upload().
 *
 * @param data  The value, little endian, with as many bytes as the object has. Is copied.
 * @param size  Its bytes.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_canopen_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
 *          igh_cia402_settings_t.sdo_buffer_bytes.
 */
ECAN_MUST_CHECK
int igh_canopen_sdo_start_download(igh_cia402_context_t *context,
                                   size_t node,
                                   uint16_t index,
                                   uint8_t subindex,
                                   const void *data,
                                   size_t size);

/**
 * Gets the state of the last transfer with a node, as igh_cia402_sdo_poll().
 *
 * @param state   Gets an igh_cia402_sdo_state_t.
 * @param data    Gets the value of a finished upload, little endian; may be NULL with size 0.
 * @param size    Bytes of the buffer.
 * @param length  Gets the bytes of the value, even if it does not fit; 0 while there is none.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, also for a failed transfer, whose reason is in ecan_last_error() and
 *          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_NODE.
 */
int igh_canopen_sdo_poll(igh_cia402_context_t *context,
                         size_t node,
                         uint8_t *state,
                         void *data,
                         size_t size,
                         size_t *length);

/* ---------------------------------------------------------------------------
 * TIME, guarding, store and restore
 *
 * The calls with a timeout run the cycle, with the axes at their last targets. On a master of another owner
 * write the objects with igh_canopen_sdo_start_download(): 0x100C and 0x100D for guarding, 0x1010 with "save",
 * 0x1011 with "load".
 * --------------------------------------------------------------------------- */

/**
 * Group of parameters in igh_canopen_store_parameters() and igh_canopen_restore_parameters(): subindex of
 * 0x1010 and 0x1011. Subindices from 4 to 127 are the manufacturer's.
 */
typedef enum {
    /** All parameters. */
    IGH_CANOPEN_PARAMETERS_ALL = 1,
    /** Communication parameters, 0x1000 to 0x1FFF. */
    IGH_CANOPEN_PARAMETERS_COMMUNICATION = 2,
    /** Application parameters, 0x6000 to 0x9FFF. */
    IGH_CANOPEN_PARAMETERS_APPLICATION = 3
} igh_canopen_parameters_t;

/**
 * Starts, changes or stops the production of TIME on every channel that has a node. Nodes that consume
 * it have bit 31 in 0x1012. The bus clock continues the time: call it again to follow adjustments of the
 * system clock.
 *
 * @param period_ms  Time between two messages, in milliseconds; 0 stops.
 * @param unix_ns    Present Unix time in nanoseconds, from 1984 to 2163; 0 for that of the system
 *                   clock.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT for a time out of range.
 */
int igh_canopen_set_time(igh_cia402_context_t *context,
                         uint32_t period_ms,
                         uint64_t unix_ns);

/**
 * Guards a node in place of its heartbeat: writes 0x1017 = 0, 0x100C and 0x100D, and requests its NMT
 * state from then on. The node detects by the requests that the host runs. With both values 0 it ends
 * guarding in node and host. igh_canopen_get_node_state() reports the result.
 *
 * @param guard_time_ms     Time between two requests in milliseconds, 1 to 65535; 0 to end.
 * @param life_time_factor  Host and node react after this multiple of the guard time, 1 to 255; 0 to end.
 * @param timeout_ms        Timeout for the writes, in milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_CANOPEN or ECAN_ERR_SDO if the node rejects an object; ECAN_ERR_TIMEOUT,
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_NODE; ECAN_ERR_ORDER if the bus is not active;
 *          ECAN_ERR_ATTACHED on a master of another owner.
 */
ECAN_MUST_CHECK
int igh_canopen_set_guarding(igh_cia402_context_t *context,
                             size_t node,
                             uint16_t guard_time_ms,
                             uint8_t life_time_factor,
                             uint32_t timeout_ms);

/**
 * Stores the present parameters of a node in its memory (0x1010), if it can do that on command.
 *
 * @param group       An igh_canopen_parameters_t, or a subindex of the manufacturer, 4 to 127.
 * @param timeout_ms  Milliseconds. A node may need seconds to write its memory.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_CANOPEN or ECAN_ERR_SDO if the node cannot or does not store;
 *          otherwise as igh_canopen_set_guarding().
 */
ECAN_MUST_CHECK
int igh_canopen_store_parameters(igh_cia402_context_t *context,
                                 size_t node,
                                 uint8_t group,
                                 uint32_t timeout_ms);

/**
 * Restores the default parameters of a node (0x1011), if it can do that on command. They become valid
 * with its next reset: igh_canopen_send_nmt(), or igh_canopen_boot_again() for a node that boots.
 *
 * @param group       An igh_canopen_parameters_t, or a subindex of the manufacturer, 4 to 127.
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_canopen_store_parameters().
 */
ECAN_MUST_CHECK
int igh_canopen_restore_parameters(igh_cia402_context_t *context,
                                   size_t node,
                                   uint8_t group,
                                   uint32_t timeout_ms);

/* ---------------------------------------------------------------------------
 * Errors of nodes
 *
 * Emergency messages since the host runs, and the error history 0x1003 in the node.
 * --------------------------------------------------------------------------- */

/** Emergency messages that are kept per node. */
#define IGH_CANOPEN_MAX_EMERGENCIES 8

/** Most entries of an error history. */
#define IGH_CANOPEN_MAX_HISTORY 254

/** An emergency message. */
typedef struct {
    /** Time of the cycle that received it, on the clock of ecan_igh_now_ns(). */
    uint64_t at_ns;
    /** Error code, 0x8611 for example; 0 resets an error. */
    uint16_t code;
    /** Error register 0x1001. */
    uint8_t error_register;
    /** Bytes of the manufacturer. */
    uint8_t data[5];
    /** Zero; for fields of later versions. */
    uint64_t reserved[2];
} igh_canopen_emergency_t;

/** An entry of the error history 0x1003. */
typedef struct {
    /** Error code, as in the emergency message. */
    uint16_t code;
    /** Additional information of the manufacturer. */
    uint16_t additional;
    /** Zero; for fields of later versions. */
    uint32_t reserved;
} igh_canopen_history_entry_t;

/**
 * Gets the last emergency messages of a node, newest first; igh_canopen_get_node_state() has their
 * number since the host runs.
 *
 * @param emergencies  Gets the messages that fit.
 * @param capacity     Size of `emergencies`; at most IGH_CANOPEN_MAX_EMERGENCIES messages are kept.
 * @param count        Gets the number of stored messages.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NODE.
 */
int igh_canopen_get_emergencies(igh_cia402_context_t *context,
                                size_t node,
                                igh_canopen_emergency_t *emergencies,
                                size_t capacity,
                                size_t *count);

/**
 * Reads the error history of a node, newest entry first. Runs the cycle, with the axes at their last
 * targets.
 *
 * @param entries     Gets the entries that fit.
 * @param capacity    Size of `entries`; a history has at most IGH_CANOPEN_MAX_HISTORY.
 * @param count       Gets the number of entries of the node, even if they do not all fit.
 * @param timeout_ms  Timeout for each of the two parts, number and entries, in milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_BUFFER if not all fit; ECAN_ERR_CANOPEN or ECAN_ERR_SDO for a node
 *          without the object; ECAN_ERR_TIMEOUT, ECAN_ERR_NODE; ECAN_ERR_ORDER if the bus is not
 *          active; ECAN_ERR_ATTACHED on a master of another owner.
 */
ECAN_MUST_CHECK
int igh_canopen_read_error_history(igh_cia402_context_t *context,
                                   size_t node,
                                   igh_canopen_history_entry_t *entries,
                                   size_t capacity,
                                   size_t *count,
                                   uint32_t timeout_ms);

/**
 * Clears the error history of a node.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_canopen_read_error_history().
 */
ECAN_MUST_CHECK
int igh_canopen_clear_error_history(igh_cia402_context_t *context,
                                    size_t node,
                                    uint32_t timeout_ms);

/* ---------------------------------------------------------------------------
 * LSS: node-IDs and bit rates (CiA 305)
 *
 * Each channel of the network has one LSS master. igh_canopen_lss() executes a command and waits;
 * igh_canopen_lss_start() begins one, and the cycle continues it. The services that configure or read a
 * slave need it in the configuration state, and no other slave with it.
 *
 * igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_FASTSCAN);          a slave without node-ID
 * igh_canopen_lss(&mcan, 0, 0, &lss, &found, 30000);
 * igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_CONFIGURE_NODE_ID);
 * lss.node_id = 5;
 * igh_canopen_lss(&mcan, 0, 0, &lss, NULL, 1000);
 * igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_SWITCH_GLOBAL);     it boots as node 5
 * igh_canopen_lss(&mcan, 0, 0, &lss, NULL, 1000);
 * --------------------------------------------------------------------------- */

/** Service of an LSS command. */
typedef enum {
    /**
     * Switches all slaves to the configuration state, or with `configuration` 0 to the waiting
     * state. No slave responds. A slave that got a node-ID boots when it returns to the waiting
     * state.
     */
    IGH_CANOPEN_LSS_SWITCH_GLOBAL = 1,
    /** Switches the slave with this address to the configuration state. */
    IGH_CANOPEN_LSS_SWITCH_SELECTIVE = 2,
    /**
     * Configures the node-ID; 255 removes it. A slave that has one uses the new one after the NMT
     * command Reset communication.
     */
    IGH_CANOPEN_LSS_CONFIGURE_NODE_ID = 3,
    /** Configures the bit rate, which IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE activates. */
    IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE = 4,
    /**
     * Activates the configured bit rates of all slaves in the configuration state after delay_ms.
     * They are silent for the same time again, and the command ends after both. The channel of
     * the gateway needs the new bit rate then.
     */
    IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE = 5,
    /** Stores node-ID and bit rate in the slave. */
    IGH_CANOPEN_LSS_STORE = 6,
    /** Reads the address. */
    IGH_CANOPEN_LSS_INQUIRE_ADDRESS = 7,
    /** Reads the node-ID. */
    IGH_CANOPEN_LSS_INQUIRE_NODE_ID = 8,
    /**
     * Searches slaves with this vendor-ID and product code, and numbers from those of the address
     * to revision_max and serial_max.
     */
    IGH_CANOPEN_LSS_IDENTIFY = 9,
    /** Searches slaves without node-ID. */
    IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED = 10,
    /**
     * Searches the lowest address among the slaves without node-ID, and switches that slave to
     * the configuration state. `known` names the parts of the address that are known.
     */
    IGH_CANOPEN_LSS_FASTSCAN = 11
} igh_canopen_lss_service_t;

/** Parts of an address that a fastscan need not search, in igh_canopen_lss_command_t.known. */
typedef enum {
    /** Vendor-ID. */
    IGH_CANOPEN_LSS_KNOWN_VENDOR_ID = 1,
    /** Product code. */
    IGH_CANOPEN_LSS_KNOWN_PRODUCT_CODE = 2,
    /** Revision number. */
    IGH_CANOPEN_LSS_KNOWN_REVISION_NUMBER = 4,
    /** Serial number. */
    IGH_CANOPEN_LSS_KNOWN_SERIAL_NUMBER = 8
} igh_canopen_lss_known_t;

/** State of the LSS master of a channel. */
typedef enum {
    /** No command was started yet. */
    IGH_CANOPEN_LSS_IDLE = 0,
    /** A command is running. */
    IGH_CANOPEN_LSS_RUNNING = 1,
    /** The last command is done. */
    IGH_CANOPEN_LSS_DONE = 2,
    /** The last command failed. */
    IGH_CANOPEN_LSS_FAILED = 3
} igh_canopen_lss_state_t;

/** Kind of the result of an LSS command. */
typedef enum {
    /** There is none. */
    IGH_CANOPEN_LSS_OUTCOME_NONE = 0,
    /** The command was sent, or the slave confirmed it. */
    IGH_CANOPEN_LSS_OUTCOME_DONE = 1,
    /** `address` is that of the slave: INQUIRE_ADDRESS, FASTSCAN. */
    IGH_CANOPEN_LSS_OUTCOME_ADDRESS = 2,
    /** `node_id` is that of the slave: INQUIRE_NODE_ID. */
    IGH_CANOPEN_LSS_OUTCOME_NODE_ID = 3,
    /** At least one slave responded to a search. */
    IGH_CANOPEN_LSS_OUTCOME_FOUND = 4,
    /** No slave responded to a search. */
    IGH_CANOPEN_LSS_OUTCOME_NOT_FOUND = 5
} igh_canopen_lss_outcome_t;

/** LSS address of a slave: its identity object 0x1018. */
typedef struct {
    /** Vendor-ID, 0x1018:01. */
    uint32_t vendor_id;
    /** Product code, 0x1018:02. */
    uint32_t product_code;
    /** Revision number, 0x1018:03. */
    uint32_t revision_number;
    /** Serial number, 0x1018:04. */
    uint32_t serial_number;
} igh_canopen_lss_address_t;

/** An LSS command. igh_canopen_lss_init() fills it; change fields after it. */
typedef struct {
    /**
     * Address of the slave; for IDENTIFY with the lowest revision and serial number, for FASTSCAN the
     * parts in `known`.
     */
    igh_canopen_lss_address_t address;
    /** Highest revision number of IDENTIFY. Default 0xFFFFFFFF. */
    uint32_t revision_max;
    /** Highest serial number of IDENTIFY. Default 0xFFFFFFFF. */
    uint32_t serial_max;
    /**
     * Bit rate of CONFIGURE_BIT_RATE in bit/s: 1000000, 800000, 500000, 250000, 125000, 50000, 20000
     * or 10000; 0 for automatic detection.
     */
    uint32_t bit_rate;
    /** Delay of ACTIVATE_BIT_RATE in milliseconds. */
    uint16_t delay_ms;
    /** An igh_canopen_lss_service_t. */
    uint8_t service;
    /** Node-ID of CONFIGURE_NODE_ID, 1 to 127; 255 for none. Default 255. */
    uint8_t node_id;
    /** 1: SWITCH_GLOBAL switches to the configuration state. Default 0. */
    uint8_t configuration;
    /** Sum of igh_canopen_lss_known_t. Default 0. */
    uint8_t known;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved[30];
} igh_canopen_lss_command_t;

/** Result of an LSS command. */
typedef struct {
    /** Address, if `outcome` is IGH_CANOPEN_LSS_OUTCOME_ADDRESS. */
    igh_canopen_lss_address_t address;
    /** An igh_canopen_lss_outcome_t. */
    uint8_t outcome;
    /** Node-ID, if `outcome` is IGH_CANOPEN_LSS_OUTCOME_NODE_ID; 255 if the slave has none. */
    uint8_t node_id;
    /** Zero; for fields of later versions. */
    uint8_t reserved[14];
} igh_canopen_lss_result_t;

/**
 * Fills a command: to the waiting state, no node-ID, all revision and serial numbers.
 *
 * @param command  Is overwritten.
 * @param service  An igh_canopen_lss_service_t.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT for a number that is not a service.
 */
int igh_canopen_lss_init(igh_canopen_lss_command_t *command, uint8_t service);

/**
 * Executes an LSS command and waits. Runs the cycle, with axes on the Port at their last targets;
 * without axes it drops other received frames.
 *
 * @param slave       Slave index of the gateway.
 * @param channel     Channel of the gateway, 0 to 3, enabled.
 * @param command     Filled by igh_canopen_lss_init().
 * @param result      Gets the result; may be NULL.
 * @param timeout_ms  Total time in milliseconds. A fastscan takes four seconds with the default
 *                    waiting times.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_TIMEOUT if no slave responded; ECAN_ERR_CANOPEN if the slave rejected
 *          the command, with the reason in ecan_last_error(); ECAN_ERR_ORDER if another command is
 *          running on the channel, or the bus is not active; ECAN_ERR_ARGUMENT, ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL, ECAN_ERR_NOT_READY, ECAN_ERR_MASTER; ECAN_ERR_ATTACHED on a master of
 *          another owner, use igh_canopen_lss_start() there.
 */
ECAN_MUST_CHECK
int igh_canopen_lss(igh_mcan_port_t *port,
                    size_t slave,
                    uint8_t channel,
                    const igh_canopen_lss_command_t *command,
                    igh_canopen_lss_result_t *result,
                    uint32_t timeout_ms);

/**
 * Adds a channel without nodes to the network, for igh_canopen_lss_start(). It gets neither SYNC nor
 * the host's heartbeat.
 *
 * @param slave    Slave index of the gateway.
 * @param channel  Channel of the gateway, 0 to 3, enabled.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, also for a channel that the network has; ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
 */
int igh_canopen_add_channel(igh_cia402_context_t *context,
                            size_t slave,
                            uint8_t channel);

/**
 * Starts an LSS command on a channel that has a node, or was added. igh_canopen_lss_poll() reports its
 * end in later cycles.
 *
 * @param slave    Slave index of the gateway.
 * @param channel  Channel of the gateway.
 * @param command  Filled by igh_canopen_lss_init(). Is copied.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ORDER if another command is running on the channel; ECAN_ERR_CHANNEL
 *          for a channel that the network does not have; ECAN_ERR_ARGUMENT.
 */
ECAN_MUST_CHECK
int igh_canopen_lss_start(igh_cia402_context_t *context,
                          size_t slave,
                          uint8_t channel,
                          const igh_canopen_lss_command_t *command);

/**
 * Gets the state of the LSS master of a channel.
 *
 * @param state   Gets an igh_canopen_lss_state_t.
 * @param result  Gets the result of a command that is done, else zeros; may be NULL.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, also for a failed command, whose reason is in ecan_last_error() with the code in
 *          ecan_last_error_code().
 */
int igh_canopen_lss_poll(igh_cia402_context_t *context,
                         size_t slave,
                         uint8_t channel,
                         uint8_t *state,
                         igh_canopen_lss_result_t *result);

/**
 * Cancels the LSS command of a channel, if any. The state of the slaves is then unknown.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK.
 */
int igh_canopen_lss_cancel(igh_cia402_context_t *context, size_t slave, uint8_t channel);

/**
 * Sets the waiting times of the LSS master of a channel of the network, for igh_canopen_lss_start(),
 * and for igh_canopen_lss() with axes.
 *
 * @param timeout_ms        Timeout for a response, and the waiting time of a search, in
 *                          milliseconds. Default 500.
 * @param store_timeout_ms  Timeout for storing. Default 5000.
 * @param scan_ms           Waiting time of each request of a fastscan, within which all slaves must
 *                          respond. Default 25.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_CHANNEL for a channel that the network does not have; ECAN_ERR_ARGUMENT
 *          for a time of 0.
 */
int igh_canopen_lss_set_times(igh_cia402_context_t *context,
                              size_t slave,
                              uint8_t channel,
                              uint32_t timeout_ms,
                              uint32_t store_timeout_ms,
                              uint32_t scan_ms);

/* ---------------------------------------------------------------------------
 * Multiplexed PDOs (CiA 301, 7.2.2.4)
 *
 * One object per frame, addressed in the frame. Send the bytes by igh_mcan_port_send_can() with the COB-ID
 * of the RPDO, and read those of igh_cia402_process_rx_ex() or igh_mcan_port_receive().
 * --------------------------------------------------------------------------- */

/** Bytes of an MPDO. */
#define IGH_CANOPEN_MPDO_BYTES 8

/** A multiplexed PDO. */
typedef struct {
    /** Index of the object. */
    uint16_t index;
    /** Subindex of the object. */
    uint8_t subindex;
    /**
     * 1: source address mode, an object of the producer `node_id`. 0: destination address mode,
     * an object of the consumer.
     */
    uint8_t is_source;
    /** Node-ID, 1 to 127; 0 in destination address mode for all consumers. */
    uint8_t node_id;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved[7];
    /** Value, little endian; bytes beyond the length of the object have no meaning. */
    uint8_t data[4];
} igh_canopen_mpdo_t;

/**
 * Encodes an MPDO.
 *
 * @param mpdo  The MPDO.
 * @param data  Gets IGH_CANOPEN_MPDO_BYTES bytes, the data of the CAN frame.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT for a node-ID out of range.
 */
int igh_canopen_mpdo_encode(const igh_canopen_mpdo_t *mpdo, uint8_t *data);

/**
 * Decodes an MPDO.
 *
 * @param mpdo    Gets the MPDO.
 * @param data    Data of a CAN frame.
 * @param length  Its bytes.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_FRAME for data that are not an MPDO.
 */
int igh_canopen_mpdo_decode(igh_canopen_mpdo_t *mpdo, const uint8_t *data, size_t length);

#ifdef __cplusplus
}
#endif

#endif /* IGH_CANOPEN_H */
