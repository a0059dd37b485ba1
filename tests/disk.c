/* SPDX-License-Identifier: BSD-3-Clause */
/* For LD_PRELOAD: simulates file systems with faults. NO_LOCK=errno: files in the folder MOUNT cannot be
   locked. NO_RENAME=errno: they cannot be renamed; with LATE_RENAME=n only after n renames.
   DISK=bytes: files cannot grow beyond this size; with NO_FALLOCATE=1 no space can be reserved. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <sys/types.h>
#include <unistd.h>

static long given(const char *name)
{
    const char *text = getenv(name);

    return text ? atol(text) : 0;
}

static int fails(long reason)
{
    errno = (int)reason;
    return -1;
}

static int is_lockless(int file)
{
    const char *mount = getenv("MOUNT");
    char link[64], path[4096];
    ssize_t size;

    if (!mount || !given("NO_LOCK"))
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    size = readlink(link, path, sizeof path);
    return size >= (ssize_t)strlen(mount) && strncmp(path, mount, strlen(mount)) == 0;
}

#define NEXT(name) __typeof__(&name) next = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

int flock(int file, int operation)
{
    NEXT(flock);

    return is_lockless(file) ? fails(given("NO_LOCK")) : next(file, operation);
}

/* SQLite locks files by fcntl. */
int fcntl(int file, int command, ...)
{
    NEXT(fcntl);
    va_list list;
    void *argument;

    va_start(list, command);
    argument = va_arg(list, void *);
    va_end(list);
    if ((command == F_SETLK || command == F_SETLKW) && is_lockless(file))
        return fails(given("NO_LOCK"));
    return next(file, command, argument);
}

int rename(const char *from, const char *to)
{
    static long count;
    NEXT(rename);

    if (strstr(to, "__pycache__")) /* bytecode files, written by Python for changed sources */
        return next(from, to);
    if (given("NO_RENAME") && ++count > given("LATE_RENAME"))
        return fails(given("NO_RENAME"));
    return next(from, to);
}

ssize_t pwrite(int file, const void *bytes, size_t size, off_t at)
{
    NEXT(pwrite);

    if (given("DISK") && at + (off_t)size > given("DISK"))
        return fails(ENOSPC);
    return next(file, bytes, size, at);
}

int fallocate(int file, int mode, off_t at, off_t size)
{
    NEXT(fallocate);

    if (given("NO_FALLOCATE"))
        return fails(EOPNOTSUPP);
    if (given("DISK") && at + size > given("DISK"))
        return fails(ENOSPC);
    return next(file, mode, at, size);
}

int statvfs(const char *path, struct statvfs *disk)
{
    NEXT(statvfs);
    int status = next(path, disk);

    if (given("DISK"))
        disk->f_bavail = (unsigned long)given("DISK") / disk->f_frsize;
    return status;
}

/* Names used by programs with 64-bit offsets. */
#define ALSO(name, other) extern __typeof__(name) other##_alias __asm__(#other) __attribute__((alias(#name), copy(name)))
ALSO(fcntl, fcntl64);
ALSO(pwrite, pwrite64);
ALSO(fallocate, fallocate64);
ALSO(statvfs, statvfs64);
