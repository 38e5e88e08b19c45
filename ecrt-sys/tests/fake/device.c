/*
 * A device of IgH's kernel module for the tests of programs, preloaded before the program
 * (LD_PRELOAD): /dev/EtherCAT104 opens, and its module has ioctl interface 39.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>

static int device = -1;

static int is_device(const char *path) { return strcmp(path, "/dev/EtherCAT104") == 0; }

/* Each name that a C library has for the call. */
#define OPEN(name)                                                            \
    int name(const char *path, int flags, ...)                                \
    {                                                                         \
        va_list arguments;                                                    \
        va_start(arguments, flags);                                           \
        mode_t mode = va_arg(arguments, mode_t);                              \
        va_end(arguments);                                                    \
        int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, #name);        \
        if (is_device(path)) return device = next("/dev/null", O_RDWR);       \
        return next(path, flags, mode);                                       \
    }
OPEN(open)
OPEN(open64)

int ioctl(int file, unsigned long request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if (file == device && request == 0x8008a400) {
        uint32_t module[2] = { 39, 1 };
        memcpy(data, module, sizeof(module));
        return 0;
    }
    int (*next)(int, unsigned long, ...) = dlsym(RTLD_NEXT, "ioctl");
    return next(file, request, data);
}
