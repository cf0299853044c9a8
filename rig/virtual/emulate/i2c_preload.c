/* Lets unmodified programs (i2c-tools, smbus2, any logger) see an emulated I2C bus behind /dev/i2c-N.
 *
 *     cc -shared -fPIC -O2 -o i2c_preload.so i2c_preload.c -ldl -lpthread
 *     LD_PRELOAD=./i2c_preload.so SHOCKRIG_I2C_1=/path/of/i2c.socket i2ctransfer -y 1 r4@0x28
 *
 * open() of /dev/i2c-N (or /dev/i2c/N) connects to the socket that SHOCKRIG_I2C_N names; everything else goes to the
 * kernel as before. One SOCK_SEQPACKET packet is one transaction, integers in the machine's own byte order:
 *     request   u16 messages, then for each: u16 address, u16 flags (1: read), u16 length, the bytes of a write
 *     reply     i32 errno (0: good), then the bytes of all reads in order
 * ioctls: linux/i2c-dev.h. SMBus calls are made of transactions as in the kernel's i2c-core-smbus.c.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#define MOST_BUSES 64
#define LONGEST_PACKET 65536
#define DEADLINE_S 5 /* an emulator that does not answer must not hang the program */
#define FUNCTIONS                                                                                                      \
    (I2C_FUNC_I2C | I2C_FUNC_SMBUS_QUICK | I2C_FUNC_SMBUS_BYTE | I2C_FUNC_SMBUS_BYTE_DATA | I2C_FUNC_SMBUS_WORD_DATA | \
     I2C_FUNC_SMBUS_I2C_BLOCK)

static struct {
    int fd; /* plus one, so that zero is a free place */
    int address;
} opened[MOST_BUSES];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

/* libc's own function, looked up once */
#define REAL(name)                                                                                                     \
    (__extension__({                                                                                                   \
        static __typeof__(&name) real;                                                                                 \
        if (!real)                                                                                                     \
            real = (__typeof__(&name))dlsym(RTLD_NEXT, #name);                                                         \
        real;                                                                                                          \
    }))

static int place_of(int fd)
{
    for (int i = 0; i < MOST_BUSES; i++)
        if (fd >= 0 && opened[i].fd == fd + 1)
            return i;
    return -1;
}

/* The socket behind a device file; NULL where the file is none of ours. */
static const char *socket_of(const char *path)
{
    char name[64], rest;
    unsigned bus;
    if (!path || (sscanf(path, "/dev/i2c-%u%c", &bus, &rest) != 1 && sscanf(path, "/dev/i2c/%u%c", &bus, &rest) != 1))
        return NULL;
    snprintf(name, sizeof name, "SHOCKRIG_I2C_%u", bus);
    return getenv(name);
}

static int open_bus(const char *path, int flags)
{
    struct sockaddr_un where = {.sun_family = AF_UNIX};
    struct timeval deadline = {.tv_sec = DEADLINE_S};
    if (strlen(path) >= sizeof where.sun_path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    strcpy(where.sun_path, path);
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | (flags & O_CLOEXEC ? SOCK_CLOEXEC : 0), 0);
    if (fd < 0)
        return -1;
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &deadline, sizeof deadline);
    if (connect(fd, (struct sockaddr *)&where, sizeof where) < 0) {
        REAL(close)(fd);
        errno = ENOENT; /* no emulator, no device */
        return -1;
    }
    pthread_mutex_lock(&lock);
    int i = 0;
    while (i < MOST_BUSES && opened[i].fd)
        i++;
    if (i < MOST_BUSES) {
        opened[i].fd = fd + 1;
        opened[i].address = 0;
    }
    pthread_mutex_unlock(&lock);
    if (i == MOST_BUSES) {
        REAL(close)(fd);
        errno = EMFILE;
        return -1;
    }
    return fd;
}

/* One transaction; 0, or -1 with the errno that the emulated adapter gives. */
static int transfer(int fd, const struct i2c_msg *messages, unsigned count)
{
    static uint8_t packet[LONGEST_PACKET]; /* guarded by the lock */
    size_t used = 2;
    uint16_t head[3] = {count};
    pthread_mutex_lock(&lock);
    int error = 0;
    memcpy(packet, head, 2);
    for (unsigned i = 0; i < count && !error; i++) {
        size_t bytes = messages[i].flags & I2C_M_RD ? 0 : messages[i].len;
        if (messages[i].flags & ~(I2C_M_RD | I2C_M_STOP))
            error = EOPNOTSUPP; /* ten-bit addresses and block lengths from the device: no such sensor here */
        else if (used + sizeof head + bytes > sizeof packet)
            error = EINVAL;
        else {
            head[0] = messages[i].addr, head[1] = messages[i].flags & I2C_M_RD, head[2] = messages[i].len;
            memcpy(packet + used, head, sizeof head);
            if (bytes)
                memcpy(packet + used + sizeof head, messages[i].buf, bytes);
            used += sizeof head + bytes;
        }
    }
    ssize_t came = 0;
    if (!error) {
        if (send(fd, packet, used, MSG_NOSIGNAL) < 0)
            error = ENODEV;
        else if ((came = recv(fd, packet, sizeof packet, 0)) < 4) {
            error = came < 0 && (errno == EAGAIN || errno == EWOULDBLOCK) ? ETIMEDOUT : ENODEV;
            shutdown(fd, SHUT_RDWR); /* a late answer must not be taken for that of the next transaction */
        } else {
            int32_t answer;
            memcpy(&answer, packet, 4);
            error = answer;
        }
    }
    uint8_t *next = packet + 4, *end = packet + came;
    for (unsigned i = 0; i < count && !error; i++) {
        if (!(messages[i].flags & I2C_M_RD))
            continue;
        if (end - next < messages[i].len)
            error = EPROTO;
        else {
            memcpy(messages[i].buf, next, messages[i].len);
            next += messages[i].len;
        }
    }
    pthread_mutex_unlock(&lock);
    if (error) {
        errno = error;
        return -1;
    }
    return 0;
}

static int smbus(int fd, int address, const struct i2c_smbus_ioctl_data *call)
{
    uint8_t out[2 + I2C_SMBUS_BLOCK_MAX] = {call->command};
    uint8_t in[I2C_SMBUS_BLOCK_MAX] = {0};
    int reads = call->read_write == I2C_SMBUS_READ;
    struct i2c_msg messages[2] = {{.addr = address, .len = 1, .buf = out},
                                  {.addr = address, .flags = I2C_M_RD, .len = 0, .buf = in}};
    union i2c_smbus_data *data = call->data;
    int words = 0;
    switch (call->size) {
    case I2C_SMBUS_QUICK:
        messages[0].len = 0;
        messages[0].flags = reads ? I2C_M_RD : 0;
        return transfer(fd, messages, 1);
    case I2C_SMBUS_BYTE:
        messages[1].len = 1;
        if (!reads)
            return transfer(fd, messages, 1);
        if (transfer(fd, messages + 1, 1) < 0)
            return -1;
        data->byte = in[0];
        return 0;
    case I2C_SMBUS_BYTE_DATA:
        words = 1;
        out[1] = reads ? 0 : data->byte;
        break;
    case I2C_SMBUS_WORD_DATA:
        words = 2;
        out[1] = reads ? 0 : data->word & 0xff;
        out[2] = reads ? 0 : data->word >> 8;
        break;
    case I2C_SMBUS_I2C_BLOCK_DATA:
        words = data->block[0];
        if (words < 1 || words > I2C_SMBUS_BLOCK_MAX) {
            errno = EINVAL;
            return -1;
        }
        memcpy(out + 1, data->block + 1, reads ? 0 : words);
        break;
    default:
        errno = EOPNOTSUPP;
        return -1;
    }
    if (!reads) {
        messages[0].len = 1 + words;
        return transfer(fd, messages, 1);
    }
    messages[1].len = words;
    if (transfer(fd, messages, 2) < 0)
        return -1;
    if (call->size == I2C_SMBUS_BYTE_DATA)
        data->byte = in[0];
    else if (call->size == I2C_SMBUS_WORD_DATA)
        data->word = in[0] | in[1] << 8;
    else
        memcpy(data->block + 1, in, words);
    return 0;
}

static int bus_ioctl(int i, unsigned long request, void *argument)
{
    int fd = opened[i].fd - 1;
    switch (request) {
    case I2C_FUNCS:
        *(unsigned long *)argument = FUNCTIONS;
        return 0;
    case I2C_SLAVE:
    case I2C_SLAVE_FORCE:
        if ((uintptr_t)argument > 0x7f) {
            errno = EINVAL;
            return -1;
        }
        opened[i].address = (int)(uintptr_t)argument;
        return 0;
    case I2C_TENBIT:
    case I2C_PEC:
    case I2C_RETRIES:
    case I2C_TIMEOUT:
        return 0;
    case I2C_RDWR: {
        struct i2c_rdwr_ioctl_data *all = argument;
        if (!all->msgs || all->nmsgs > I2C_RDWR_IOCTL_MAX_MSGS) {
            errno = EINVAL;
            return -1;
        }
        return transfer(fd, all->msgs, all->nmsgs) < 0 ? -1 : (int)all->nmsgs;
    }
    case I2C_SMBUS:
        return smbus(fd, opened[i].address, argument);
    }
    errno = ENOTTY;
    return -1;
}

int ioctl(int fd, unsigned long request, ...)
{
    va_list list;
    va_start(list, request);
    void *argument = va_arg(list, void *);
    va_end(list);
    int i = place_of(fd);
    return i < 0 ? REAL(ioctl)(fd, request, argument) : bus_ioctl(i, request, argument);
}

#define OPEN(name, before, ...)                                                                                        \
    int name(before const char *path, int flags, ...)                                                                  \
    {                                                                                                                  \
        mode_t mode = 0;                                                                                               \
        if (flags & (O_CREAT | (__O_TMPFILE & ~O_DIRECTORY))) {                                                        \
            va_list list;                                                                                              \
            va_start(list, flags);                                                                                     \
            mode = va_arg(list, mode_t);                                                                               \
            va_end(list);                                                                                              \
        }                                                                                                              \
        const char *behind = socket_of(path);                                                                          \
        return behind ? open_bus(behind, flags) : REAL(name)(__VA_ARGS__ path, flags, mode);                           \
    }
#define COMMA ,
OPEN(open, , )
OPEN(open64, , )
OPEN(openat, int folder COMMA, folder COMMA)
OPEN(openat64, int folder COMMA, folder COMMA)

/* what open() becomes in programs built with _FORTIFY_SOURCE */
int __open_2(const char *path, int flags)
{
    return open(path, flags);
}

int __open64_2(const char *path, int flags)
{
    return open64(path, flags);
}

ssize_t read(int fd, void *buffer, size_t length)
{
    int i = place_of(fd);
    if (i < 0)
        return REAL(read)(fd, buffer, length);
    uint16_t bytes = length > 8192 ? 8192 : length; /* as in i2c-dev.c */
    struct i2c_msg message = {.addr = opened[i].address, .flags = I2C_M_RD, .len = bytes, .buf = buffer};
    return transfer(fd, &message, 1) < 0 ? -1 : bytes;
}

ssize_t write(int fd, const void *buffer, size_t length)
{
    int i = place_of(fd);
    if (i < 0)
        return REAL(write)(fd, buffer, length);
    uint16_t bytes = length > 8192 ? 8192 : length;
    struct i2c_msg message = {.addr = opened[i].address, .len = bytes, .buf = (void *)buffer};
    return transfer(fd, &message, 1) < 0 ? -1 : bytes;
}

int close(int fd)
{
    int i = place_of(fd);
    if (i >= 0)
        opened[i].fd = 0;
    return REAL(close)(fd);
}
