/*
 * The part of libethercat's binary interface that this crate uses: the types
 * as versions 1.5.2 and 1.6.x lay them out in memory. Source of
 * src/bindings.rs (scripts/regenerate-bindings.sh). The functions stand in
 * src/functions.rs.
 */
#ifndef ECRT_ABI_H
#define ECRT_ABI_H

#include <stdint.h>

/** Sync managers a slave can have. */
#define EC_MAX_SYNC_MANAGERS 16
/** Bytes of a name, closing zero included. */
#define EC_MAX_STRING_LENGTH 64
/** Ports of a slave controller. */
#define EC_MAX_PORTS 4

/** A master, owned by the library. */
typedef struct ec_master ec_master_t;
/** The configuration of one slave, owned by its master. */
typedef struct ec_slave_config ec_slave_config_t;
/** A process data domain, owned by its master. */
typedef struct ec_domain ec_domain_t;
/** An SDO transfer that runs beside the cycle, owned by its slave configuration. */
typedef struct ec_sdo_request ec_sdo_request_t;
/** A register access that runs beside the cycle, owned by its slave configuration. */
typedef struct ec_reg_request ec_reg_request_t;

/** What all links of a master see. */
typedef struct {
    /** Slaves that answer, over all links. */
    unsigned int slaves_responding;
    /** AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP. */
    unsigned int al_states : 4;
    /** At least one link is up. */
    unsigned int link_up : 1;
} ec_master_state_t;

/** What one link of a master sees. */
typedef struct {
    /** Slaves that answer on this link. */
    unsigned int slaves_responding;
    /** AL states that occur on this link, bits as in ec_master_state_t. */
    unsigned int al_states : 4;
    /** This link is up. */
    unsigned int link_up : 1;
} ec_master_link_state_t;

/** How far the master brought a configured slave. */
typedef struct {
    /** The slave was found. */
    unsigned int online : 1;
    /** It reached OP with this configuration. */
    unsigned int operational : 1;
    /** AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP. */
    unsigned int al_state : 4;
} ec_slave_config_state_t;

/** General information about a master. */
typedef struct {
    /** Slaves found by the last scan. */
    unsigned int slave_count;
    /** The main link is up. */
    unsigned int link_up : 1;
    /** A scan is under way. */
    uint8_t scan_busy;
    /** Application time last given to the master, ns since 2000-01-01. */
    uint64_t app_time;
} ec_master_info_t;

/** Progress of a bus scan; since 1.6. */
typedef struct {
    /** Slaves to scan. */
    unsigned int slave_count;
    /** The one being scanned. */
    unsigned int scan_index;
} ec_master_scan_progress_t;

/** Kind of a slave port. */
typedef enum {
    EC_PORT_NOT_IMPLEMENTED,
    EC_PORT_NOT_CONFIGURED,
    EC_PORT_EBUS,
    EC_PORT_MII
} ec_slave_port_desc_t;

/** Link of a slave port. */
typedef struct {
    /** A link is established. */
    uint8_t link_up;
    /** The port returns frames instead of passing them on. */
    uint8_t loop_closed;
    /** A signal arrives. */
    uint8_t signal_detected;
} ec_slave_port_link_t;

/** What the master knows of a slave on the bus. */
typedef struct {
    /** Place in the ring, from 0. */
    uint16_t position;
    /** Vendor id in the slave's EEPROM. */
    uint32_t vendor_id;
    /** Product code in the slave's EEPROM. */
    uint32_t product_code;
    /** Revision in the slave's EEPROM. */
    uint32_t revision_number;
    /** Serial number in the slave's EEPROM. */
    uint32_t serial_number;
    /** Station alias, 0 when none is set. */
    uint16_t alias;
    /** Current the slave takes from the E-bus, mA. */
    int16_t current_on_ebus;
    /** The four ports. */
    struct {
        /** Kind of port. */
        ec_slave_port_desc_t desc;
        /** Link of the port. */
        ec_slave_port_link_t link;
        /** Local time at which the delay measurement frame came in, ns. */
        uint32_t receive_time;
        /** Position of the neighbour at this port, 0xffff for none. */
        uint16_t next_slave;
        /** Delay to the next slave with distributed clocks, ns. */
        uint32_t delay_to_next_dc;
    } ports[EC_MAX_PORTS];
    /** AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; bit 4 marks an error. */
    uint8_t al_state;
    /** The master met an error with this slave and holds it. */
    uint8_t error_flag;
    /** Sync managers in the EEPROM. */
    uint8_t sync_count;
    /** Objects in the dictionary, when it was fetched. */
    uint16_t sdo_count;
    /** Device name, zero terminated. */
    char name[EC_MAX_STRING_LENGTH];
} ec_slave_info_t;

/** Judgement of a domain's working counter. */
typedef enum {
    EC_WC_ZERO,
    EC_WC_INCOMPLETE,
    EC_WC_COMPLETE
} ec_wc_state_t;

/** Result of a domain's last exchange. */
typedef struct {
    /** Sum over the domain's datagrams. */
    unsigned int working_counter;
    /** That sum compared with what the master expects. */
    ec_wc_state_t wc_state;
    /** The redundant link carries data. */
    unsigned int redundancy_active;
} ec_domain_state_t;

/** Direction of a sync manager, seen from the master. */
typedef enum {
    EC_DIR_INVALID,
    EC_DIR_OUTPUT,
    EC_DIR_INPUT
} ec_direction_t;

/** Whether a sync manager feeds the slave's watchdog. */
typedef enum {
    EC_WD_DEFAULT,
    EC_WD_ENABLE,
    EC_WD_DISABLE
} ec_watchdog_mode_t;

/** One entry of a PDO mapping. */
typedef struct {
    /** Index of the mapped object. */
    uint16_t index;
    /** Its subindex. */
    uint8_t subindex;
    /** Its length, bits. */
    uint8_t bit_length;
} ec_pdo_entry_info_t;

/** One PDO. */
typedef struct {
    /** Index of the mapping object. */
    uint16_t index;
    /** Entries that follow. */
    unsigned int n_entries;
    /** The entries, or NULL. */
    ec_pdo_entry_info_t *entries;
} ec_pdo_info_t;

/** One sync manager. */
typedef struct {
    /** Number of the sync manager. */
    uint8_t index;
    /** Its direction. */
    ec_direction_t dir;
    /** PDOs that follow. */
    unsigned int n_pdos;
    /** The PDOs, or NULL. */
    ec_pdo_info_t *pdos;
    /** Its watchdog. */
    ec_watchdog_mode_t watchdog_mode;
} ec_sync_info_t;

/** One line of a registration list. */
typedef struct {
    /** Alias that the position counts from. */
    uint16_t alias;
    /** Position behind the alias. */
    uint16_t position;
    /** Expected vendor id. */
    uint32_t vendor_id;
    /** Expected product code. */
    uint32_t product_code;
    /** Index of the mapped object. */
    uint16_t index;
    /** Its subindex. */
    uint8_t subindex;
    /** Where the byte offset in the domain is stored. */
    unsigned int *offset;
    /** Where the bit position in that byte is stored, or NULL. */
    unsigned int *bit_position;
} ec_pdo_entry_reg_t;

/** State of a request. */
typedef enum {
    EC_REQUEST_UNUSED,
    EC_REQUEST_BUSY,
    EC_REQUEST_SUCCESS,
    EC_REQUEST_ERROR
} ec_request_state_t;

/** AL states as the interface codes them. */
typedef enum {
    EC_AL_STATE_INIT = 1,
    EC_AL_STATE_PREOP = 2,
    EC_AL_STATE_SAFEOP = 4,
    EC_AL_STATE_OP = 8
} ec_al_state_t;

#endif
