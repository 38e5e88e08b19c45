/* Reads or writes an object of a CANopen node through a gateway (manual 15.4).
 *
 *     igh_canopen_sdo_probe --ecrt sim --node 1 --index 0x1000 --sub 0
 *     igh_canopen_sdo_probe --ecrt sim --node 1 --index 0x6081 --sub 0 --type u32 --write 5000
 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "bring_up.h"
#include "igh_cia402_protocol.h"
#include "object_value.h"
#include "options.h"
#include "report.h"

enum { MAX_VALUE_BYTES = 1024 };

typedef struct {
    bus_settings_t bus;
    uint64_t channel, node_id, index, subindex, timeout_ms;
    const char *index_text;
    const char *type_name; /* NULL: unknown */
    object_type_t type;
    const char *written; /* NULL: only read */
} arguments_t;

/* Parses an index. The numbers of objects begin at 0x1000, so that four digits without 0x are read in
 * two ways. */
static uint64_t parse_index(const char *text)
{
    char prefixed[8];
    uint64_t meant = 0, read = 0;
    bool is_number = parse_number(text, &read) && read <= UINT16_MAX;
    bool has_prefix = text[0] == '0' && (text[1] == 'x' || text[1] == 'X');
    snprintf(prefixed, sizeof(prefixed), "0x%.5s", text);
    if (!has_prefix && strlen(text) < 5 && parse_number(prefixed, &meant) && meant >= 0x1000) {
        if (is_number) {
            options_wrong_use("--index %s: read as the decimal number of 0x%04" PRIX64 "; for the "
                              "hexadecimal index 0x%04" PRIX64 " write %s, or 0x%04" PRIX64
                              " for the other", text, read, meant, prefixed, read);
        }
        options_wrong_use("--index %s: index without prefix; for 0x%04" PRIX64 " write %s", text,
                          meant, prefixed);
    }
    if (!is_number) {
        options_wrong_use("--index %s: expected a number from 0 to 65535 (0xFFFF)", text);
    }
    return read;
}

static void parse_arguments(arguments_t *arguments, int argc, char **argv)
{
    option_list_t list = {
        .about = "Reads or writes an object of a CANopen node through an ECAN-Lite gateway."};
    *arguments = (arguments_t){.timeout_ms = 5000};
    bus_settings_default(&arguments->bus, "drives");
    bus_settings_add_options(&arguments->bus, &list);
    options_add(&list, (option_t){
        .name = "slave", .value_name = "N", .number = &arguments->bus.first_position,
        .maximum = UINT16_MAX,
        .help = "Position of the gateway"});
    options_add(&list, (option_t){
        .name = "channel", .value_name = "CHANNEL", .number = &arguments->channel,
        .maximum = ECAN_MCAN_CHANNELS - 1,
        .help = "CAN channel of the node"});
    options_add(&list, (option_t){
        .name = "node", .value_name = "ID", .number = &arguments->node_id,
        .minimum = 1, .maximum = 127, .is_required = true,
        .help = "Node id"});
    options_add(&list, (option_t){
        .name = "index", .value_name = "INDEX", .text = &arguments->index_text,
        .is_required = true,
        .help = "Index of the object, hexadecimal with 0x"});
    options_add(&list, (option_t){
        .name = "sub", .value_name = "SUB", .number = &arguments->subindex, .maximum = UINT8_MAX,
        .help = "Subindex"});
    options_add(&list, (option_t){
        .name = "type", .value_name = "TYPE", .text = &arguments->type_name,
        .help = "Type of the value: u8, u16, u32, u64, i8, i16, i32, i64, string or hex. Unset: "
                "shown as the number and the text that it may be"});
    options_add(&list, (option_t){
        .name = "write", .value_name = "VALUE", .text = &arguments->written,
        .help = "Write this value, then read it back; needs --type"});
    options_add(&list, (option_t){
        .name = "timeout-ms", .value_name = "MS", .number = &arguments->timeout_ms,
        .minimum = 1, .maximum = UINT32_MAX,
        .help = "Timeout of the transfer in milliseconds"});
    options_parse(&list, argc, argv);

    arguments->index = parse_index(arguments->index_text);
    arguments->bus.channel_masks[0] = (uint8_t)(1u << arguments->channel);
    if (arguments->written != NULL && arguments->type_name == NULL) {
        options_wrong_use("--write needs --type TYPE");
    }
    if (arguments->type_name != NULL &&
        !object_type_parse(arguments->type_name, &arguments->type)) {
        options_wrong_use("--type %s: expected u8, u16, u32, u64, i8, i16, i32, i64, string or hex",
                          arguments->type_name);
    }
}

/* Transfers through the ready gateway. */
static bool transfer(bus_t *bus, const arguments_t *arguments, const uint8_t *written,
                     size_t written_length)
{
    uint8_t data[MAX_VALUE_BYTES];
    size_t length = 0;
    uint8_t channel = (uint8_t)arguments->channel, node_id = (uint8_t)arguments->node_id;
    uint16_t index = (uint16_t)arguments->index;
    uint8_t subindex = (uint8_t)arguments->subindex;
    uint32_t timeout_ms = (uint32_t)arguments->timeout_ms;
    if (arguments->written != NULL) {
        if (igh_canopen_sdo_download(&bus->mcan, 0, channel, node_id, index, subindex, written,
                                     written_length, timeout_ms) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        printf("0x%04X:%02X written\n", index, subindex);
    }
    if (igh_canopen_sdo_upload(&bus->mcan, 0, channel, node_id, index, subindex, data,
                               sizeof(data), &length, timeout_ms) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    printf("0x%04X:%02X = ", index, subindex);
    return object_value_print(arguments->type, data, length);
}

int main(int argc, char **argv)
{
    arguments_t arguments;
    uint8_t written[MAX_VALUE_BYTES];
    size_t written_length = 0;
    bus_t bus = {0};
    parse_arguments(&arguments, argc, argv);
    if (arguments.written != NULL &&
        !object_value_encode(arguments.type, arguments.written, written, sizeof(written),
                             &written_length)) {
        return report_exit_status(false);
    }
    if (!bring_up(&bus, &arguments.bus)) {
        return report_exit_status(false);
    }
    bool is_good = transfer(&bus, &arguments, written, written_length);
    is_good &= shut_down(&bus);
    return report_exit_status(is_good);
}
