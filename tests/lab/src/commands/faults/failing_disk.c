/* Stands before the calls of the system (LD_PRELOAD), as a disk with errors would answer:
 * from its byte 20,000 on no file whose path ends in one of FAILING_WRITES (between colons) takes a write any more;
 * the first sync of the file whose path ends in FAILING_SYNC fails. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FROM_BYTE 20000

static int ends_in(int fd, const char *names) {
    char link[64], path[4096], list[4096];
    if (!names || strlen(names) >= sizeof list)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    strcpy(list, names);
    char *rest = list, *name;
    while ((name = strsep(&rest, ":"))) {
        size_t n = strlen(name);
        if (n && n <= (size_t)length && !strcmp(path + length - n, name))
            return 1;
    }
    return 0;
}

ssize_t write(int fd, const void *bytes, size_t n) {
    static ssize_t (*real)(int, const void *, size_t);
    if (!real)
        real = dlsym(RTLD_NEXT, "write");
    struct stat file;
    if (fd > 2 && ends_in(fd, getenv("FAILING_WRITES")) && !fstat(fd, &file) && file.st_size >= FROM_BYTE) {
        errno = EIO;
        return -1;
    }
    return real(fd, bytes, n);
}

int fdatasync(int fd) {
    static int (*real)(int), has_failed;
    if (!real)
        real = dlsym(RTLD_NEXT, "fdatasync");
    if (!has_failed && ends_in(fd, getenv("FAILING_SYNC"))) {
        has_failed = 1;
        errno = EIO;
        return -1;
    }
    return real(fd);
}
