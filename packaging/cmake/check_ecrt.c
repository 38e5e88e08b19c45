/* Compiled by CheckEcrt.cmake: sizes and offsets of the types that the SDK shares with
 * libethercat. */
#include <stddef.h>

#include <ecrt.h>

#define SIZE(type, bytes) _Static_assert(sizeof(type) == (bytes), "size of " #type)
#define PLACE(type, field, bytes) \
    _Static_assert(offsetof(type, field) == (bytes), "place of " #field " in " #type)

SIZE(ec_master_state_t, 8);
PLACE(ec_master_state_t, slaves_responding, 0);
SIZE(ec_master_link_state_t, 8);
SIZE(ec_slave_config_state_t, 4);
SIZE(ec_master_info_t, 16);
PLACE(ec_master_info_t, slave_count, 0);
PLACE(ec_master_info_t, app_time, 8);
SIZE(ec_slave_port_desc_t, 4);
SIZE(ec_slave_port_link_t, 3);
SIZE(ec_slave_info_t, 176);
PLACE(ec_slave_info_t, position, 0);
PLACE(ec_slave_info_t, vendor_id, 4);
PLACE(ec_slave_info_t, product_code, 8);
PLACE(ec_slave_info_t, revision_number, 12);
PLACE(ec_slave_info_t, serial_number, 16);
PLACE(ec_slave_info_t, alias, 20);
PLACE(ec_slave_info_t, current_on_ebus, 22);
PLACE(ec_slave_info_t, ports, 24);
PLACE(ec_slave_info_t, ports[1], 44);
PLACE(ec_slave_info_t, ports[0].desc, 24);
PLACE(ec_slave_info_t, ports[0].link, 28);
PLACE(ec_slave_info_t, ports[0].receive_time, 32);
PLACE(ec_slave_info_t, ports[0].next_slave, 36);
PLACE(ec_slave_info_t, ports[0].delay_to_next_dc, 40);
PLACE(ec_slave_info_t, al_state, 104);
PLACE(ec_slave_info_t, error_flag, 105);
PLACE(ec_slave_info_t, sync_count, 106);
PLACE(ec_slave_info_t, sdo_count, 108);
PLACE(ec_slave_info_t, name, 110);
SIZE(ec_domain_state_t, 12);
PLACE(ec_domain_state_t, working_counter, 0);
PLACE(ec_domain_state_t, wc_state, 4);
PLACE(ec_domain_state_t, redundancy_active, 8);
SIZE(ec_pdo_entry_info_t, 4);
PLACE(ec_pdo_entry_info_t, index, 0);
PLACE(ec_pdo_entry_info_t, subindex, 2);
PLACE(ec_pdo_entry_info_t, bit_length, 3);
SIZE(ec_pdo_info_t, 16);
PLACE(ec_pdo_info_t, index, 0);
PLACE(ec_pdo_info_t, n_entries, 4);
PLACE(ec_pdo_info_t, entries, 8);
SIZE(ec_sync_info_t, 32);
PLACE(ec_sync_info_t, index, 0);
PLACE(ec_sync_info_t, dir, 4);
PLACE(ec_sync_info_t, n_pdos, 8);
PLACE(ec_sync_info_t, pdos, 16);
PLACE(ec_sync_info_t, watchdog_mode, 24);
SIZE(ec_pdo_entry_reg_t, 32);
PLACE(ec_pdo_entry_reg_t, alias, 0);
PLACE(ec_pdo_entry_reg_t, position, 2);
PLACE(ec_pdo_entry_reg_t, vendor_id, 4);
PLACE(ec_pdo_entry_reg_t, product_code, 8);
PLACE(ec_pdo_entry_reg_t, index, 12);
PLACE(ec_pdo_entry_reg_t, subindex, 14);
PLACE(ec_pdo_entry_reg_t, offset, 16);
PLACE(ec_pdo_entry_reg_t, bit_position, 24);
SIZE(ec_request_state_t, 4);
SIZE(ec_al_state_t, 4);
SIZE(ec_direction_t, 4);
SIZE(ec_watchdog_mode_t, 4);
SIZE(ec_wc_state_t, 4);

int main(void)
{
    return 0;
}
