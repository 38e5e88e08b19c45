/* Stands for libecan_igh_host 0.1: two of its functions, under its soname and its symbol versions. */
int ecan_version(void);
const char *ecan_last_error(void);

int ecan_version(void)
{
    return 100;
}

const char *ecan_last_error(void)
{
    return "";
}
