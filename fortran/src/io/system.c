/* SPDX-License-Identifier: BSD-3-Clause */
/* POSIX functions that Fortran lacks: signals, locks, durable files. Variables are static because signal handlers take
   no arguments. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

enum { TAKEN, HELD, NO_LOCKS, NOT_WRITABLE, NO_LOCK_FILE };

/* Seconds within which several signals count as one: `timeout` signals both a process and its group. */
static const double together = 0.1;
static volatile sig_atomic_t status;  /* exit status for the first signal: 130, 143 */
static struct timespec came;          /* time of the first signal */
static char last_words[4096];         /* message printed at a crash */
static char lock[4096];               /* lock file of this process; "" for none */
static int lock_file = -1;

/* Record the first Ctrl-C or SIGTERM; a second one ends the process at once. */
static void take_signal(int number)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    if (status == 0) {
        came = now;
        status = 128 + number;
    } else if ((double)(now.tv_sec - came.tv_sec) + 1e-9 * (double)(now.tv_nsec - came.tv_nsec) > together) {
        _exit(128 + number);
    }
}

static void take_crash(int number)
{
    ssize_t written = write(STDERR_FILENO, last_words, strlen(last_words));

    (void)number, (void)written;
    if (lock[0] != '\0')
        unlink(lock);
    _exit(2);
}

/* Prepare the process: record signals; make exceeding the file size limit (ulimit -f) a write error, as on a full disk;
   open closed standard streams (>&-), so that their output does not go to a file opened later. */
void rockfall_start(void)
{
    int file;

    setenv("HDF5_USE_FILE_LOCKING", "FALSE", 0); /* rockfall needs no locks of HDF5, which fail on some disks */
    while ((file = open("/dev/null", O_RDWR)) >= 0 && file <= STDERR_FILENO)
        ;
    if (file > STDERR_FILENO)
        close(file);
    signal(SIGXFSZ, SIG_IGN);
    signal(SIGINT, take_signal);
    signal(SIGTERM, take_signal);
}

/* Exit status of a program stopped by a signal; 0 if there was none. */
int rockfall_status(void)
{
    return status;
}

/* Set the message that is printed if HDF5 crashes, as it does on some damaged files; "": none. */
void rockfall_on_crash(const char *message)
{
    const int crashes[] = {SIGABRT, SIGBUS, SIGFPE, SIGSEGV};
    size_t k;

    snprintf(last_words, sizeof last_words, "%s", message);
    for (k = 0; k < sizeof crashes / sizeof *crashes; k++)
        signal(crashes[k], message[0] == '\0' ? SIG_DFL : take_crash);
}

static int same(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

/* Return whether two paths lead to the same file. */
int rockfall_same(const char *a, const char *b)
{
    struct stat of_a, of_b;

    return stat(a, &of_a) == 0 && stat(b, &of_b) == 0 && same(&of_a, &of_b);
}

int rockfall_is_folder(const char *path)
{
    struct stat found;

    return stat(path, &found) == 0 && S_ISDIR(found.st_mode);
}

/* Return whether a path leads to a file, not to a pipe or device: opening a pipe would block until it has a writer. */
int rockfall_is_regular(const char *path)
{
    struct stat found;

    return stat(path, &found) == 0 && S_ISREG(found.st_mode);
}

/* Lock out other processes by an empty file. The system releases the lock however the process ends. */
int rockfall_lock(const char *path)
{
    struct stat named, opened;

    for (;;) {
        if (stat(path, &named) == 0 && !(S_ISREG(named.st_mode) && named.st_size == 0))
            return NO_LOCK_FILE;
        lock_file = open(path, O_WRONLY | O_CREAT | O_NOFOLLOW, 0666);
        if (lock_file < 0)
            return NOT_WRITABLE;
        if (flock(lock_file, LOCK_EX | LOCK_NB) != 0)
            break;
        if (fstat(lock_file, &opened) == 0 && stat(path, &named) == 0 && same(&opened, &named)) {
            snprintf(lock, sizeof lock, "%s", path);
            return TAKEN;
        }
        close(lock_file); /* the previous lock owner removed the file in the meantime */
    }
    if (errno != EWOULDBLOCK) {
        snprintf(lock, sizeof lock, "%s", path);
        return NO_LOCKS;
    }
    close(lock_file);
    return HELD;
}

/* Release the lock, if any. */
void rockfall_unlock(void)
{
    if (lock[0] == '\0')
        return;
    unlink(lock);
    lock[0] = '\0';
    close(lock_file);
}

/* Return whether the disk has space for a file of this size, by creating and removing it. If the system can reserve
   space, this includes quotas and `ulimit -f`. */
int rockfall_disk_holds(const char *path, int64_t bytes)
{
    struct statvfs disk;
    int file = open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW, 0600), full = 0;

    if (file < 0)
        return 1; /* any other error appears when the file is written */
#if defined(__linux__)
    full = fallocate(file, 0, 0, bytes) != 0 && (errno == ENOSPC || errno == EDQUOT || errno == EFBIG);
#endif
    close(file);
    if (!full && statvfs(path, &disk) == 0)
        full = (double)disk.f_bavail * (double)disk.f_frsize < (double)bytes;
    unlink(path);
    return !full;
}

/* Flush a file, or the names in a folder, to disk. */
static int sync_path(const char *path)
{
    int file = open(path, O_RDONLY), ok;

    if (file < 0)
        return 0;
    ok = fsync(file) == 0;
    close(file);
    return ok;
}

/* Replace a file atomically by another once it is on disk, and make the new name durable. */
int rockfall_replace(const char *from, const char *to, const char *folder)
{
    if (!sync_path(from) || rename(from, to) != 0)
        return 0;
    sync_path(folder); /* some file systems refuse this */
    return 1;
}

/* Second separator of folders in paths, if the system has one, else '/'. */
char rockfall_separator(void)
{
    return '/';
}
