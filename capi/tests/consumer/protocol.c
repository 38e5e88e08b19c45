/* libecan_mcan_host alone: writes the manual's first example image (5.4.4.1) and reads it back. */
#include <stdio.h>
#include <string.h>

#include <igh_mcan_pdo.h>

static const uint8_t EXPECTED[36] = {
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0c, 0x00, 0xd3, 0x56, 0xe7, 0x01,
    0x0f, 0x01, 0x00, 0x01, 0,    0,    0,    0,    0,    0,    0,    0,
    0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88};

int main(void)
{
    static uint8_t image[1024];
    const uint8_t data[8] = {0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88};
    igh_mcan_pdo_profile_t profile;
    igh_mcan_pdo_writer_t writer;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t frames[4];
    size_t count = 0;

    if (igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 8, 0x0f) != ECAN_OK ||
        igh_mcan_pdo_writer_init(&writer, &profile) != ECAN_OK ||
        igh_mcan_pdo_writer_begin(&writer, image, sizeof(image)) != ECAN_OK ||
        igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, data, 8) != ECAN_OK ||
        igh_mcan_pdo_writer_finish(&writer, NULL) != ECAN_OK ||
        igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), frames, 4, &count, &diag) !=
            ECAN_OK) {
        fprintf(stderr, "%s\n", ecan_last_error());
        return 1;
    }
    if (memcmp(image, EXPECTED, sizeof(EXPECTED)) != 0 || count != 1 ||
        frames[0].can_id != 0x123 || memcmp(frames[0].data, data, 8) != 0) {
        fputs("the image is not the manual's\n", stderr);
        return 1;
    }
    puts("the image is the manual's");
    return 0;
}
