/* igh_mcan_port.h: the service for other programs. */
#include "check.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

static char path[64];

static int connect_client(void)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    struct timeval limit = {.tv_sec = 20};
    int client = socket(AF_UNIX, SOCK_STREAM, 0);

    strncpy(address.sun_path, path, sizeof(address.sun_path) - 1);
    SAME(0, setsockopt(client, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit)));
    if (connect(client, (struct sockaddr *)&address, sizeof(address)) != 0) {
        close(client);
        return -1;
    }
    return client;
}

/* Says hello and returns whether the response has a text. */
static int response_has(int client, const char *text)
{
    static const char HELLO[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"hello\","
                                "\"params\":{\"version\":1,\"client\":\"every_function\"}}";
    char message[4096] = {0};
    uint8_t header[8] = {sizeof(HELLO) - 1, 0, 0, 0, 1};

    SAME(8, write(client, header, 8));
    SAME((ssize_t)sizeof(HELLO) - 1, write(client, HELLO, sizeof(HELLO) - 1));
    SAME(8, recv(client, header, 8, MSG_WAITALL));
    SAME(1, header[4]);
    size_t length = header[0] | (size_t)header[1] << 8;
    TRUE(length < sizeof(message));
    SAME((ssize_t)length, recv(client, message, length, MSG_WAITALL));
    return strstr(message, text) != NULL;
}

void test_port_service(void)
{
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    struct stat status;
    char byte;

    snprintf(path, sizeof(path), "every_function_%d.sock", (int)getpid());
    simulate_channel(&igh_config, &config, "sim:echo", 500000);
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));

    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_serve(&port, path, 4));
    BAD(ECAN_ERR_FILE, igh_mcan_port_serve(&port, "missing/directory/x.sock", 0));
    GOOD(igh_mcan_port_end_service(&port));

    GOOD(igh_mcan_port_serve(&port, path, 0));
    int client = connect_client();
    TRUE(client >= 0);
    TRUE(response_has(client, "\"access\":\"read\""));
    SAME(0, stat(path, &status));
    SAME(0660, status.st_mode & 0777);

    /* Another one at the same path replaces it. */
    GOOD(igh_mcan_port_serve(&port, path, IGH_MCAN_SERVE_CONTROL));
    SAME(0, recv(client, &byte, 1, MSG_WAITALL));
    close(client);
    client = connect_client();
    TRUE(response_has(client, "\"access\":\"control\""));

    /* It continues after a reconfiguration, and ends with the Port. */
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 250000));
    GOOD(igh_mcan_port_reconfigure(&port, &igh_config, &config));
    close(client);
    client = connect_client();
    TRUE(response_has(client, "\"bitrate\":250000"));
    close(client);
    GOOD(igh_mcan_port_end_service(&port));
    SAME(-1, connect_client());
    GOOD(igh_mcan_port_serve(&port, path, IGH_MCAN_SERVE_CONTROL_ALL));
    GOOD(igh_mcan_port_deinit(&port));
    SAME(-1, stat(path, &status));
    GOOD(ecan_igh_deinit(&igh));
}
