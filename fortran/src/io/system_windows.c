/* SPDX-License-Identifier: BSD-3-Clause */
/* Counterpart of system.c on Windows. Paths are in the code page of the process. */
#include <fcntl.h>
#include <io.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/locking.h>
#include <sys/stat.h>
#include <windows.h>

enum { TAKEN, HELD, NO_LOCKS, NOT_WRITABLE, NO_LOCK_FILE };

static volatile LONG status;     /* exit status for the first signal: 130, 143 */
static char last_words[4096];    /* message printed at a crash */
static char lock[4096];          /* lock file of this process; "" for none */
static int lock_file = -1;

/* Runs in its own thread: record the first Ctrl-C, Ctrl-Break or closed window. A second event ends the process. */
static BOOL WINAPI take_event(DWORD event)
{
    LONG code = event == CTRL_C_EVENT ? 130 : 143;

    if (InterlockedCompareExchange(&status, code, 0) != 0)
        _exit((int)code);
    return TRUE;
}

static void close_lock(void)
{
    if (lock_file >= 0)
        _close(lock_file);
    lock_file = -1;
}

static void take_crash(int number)
{
    (void)number;
    _write(2, last_words, (unsigned)strlen(last_words));
    close_lock();
    if (lock[0] != '\0')
        remove(lock);
    _exit(2);
}

void rockfall_start(void)
{
    SetErrorMode(SEM_FAILCRITICALERRORS | SEM_NOGPFAULTERRORBOX);
    SetConsoleCtrlHandler(take_event, TRUE);
}

int rockfall_status(void)
{
    return (int)status;
}

void rockfall_on_crash(const char *message)
{
    const int crashes[] = {SIGABRT, SIGFPE, SIGSEGV};
    size_t k;

    snprintf(last_words, sizeof last_words, "%s", message);
    for (k = 0; k < sizeof crashes / sizeof *crashes; k++)
        signal(crashes[k], message[0] == '\0' ? SIG_DFL : take_crash);
}

/* Find the volume and number of a file or folder; return whether it exists. */
static int identify(const char *path, BY_HANDLE_FILE_INFORMATION *found)
{
    HANDLE file = CreateFileA(path, 0, FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE, NULL, OPEN_EXISTING,
                              FILE_FLAG_BACKUP_SEMANTICS, NULL);
    int ok;

    if (file == INVALID_HANDLE_VALUE)
        return 0;
    ok = GetFileInformationByHandle(file, found) != 0;
    CloseHandle(file);
    return ok;
}

int rockfall_same(const char *a, const char *b)
{
    BY_HANDLE_FILE_INFORMATION of_a, of_b;

    return identify(a, &of_a) && identify(b, &of_b) && of_a.dwVolumeSerialNumber == of_b.dwVolumeSerialNumber &&
           of_a.nFileIndexHigh == of_b.nFileIndexHigh && of_a.nFileIndexLow == of_b.nFileIndexLow;
}

/* Return whether a path is a folder, by its attributes: Windows also finds "path/." if the path is a file. */
int rockfall_is_folder(const char *path)
{
    DWORD found = GetFileAttributesA(path);

    return found != INVALID_FILE_ATTRIBUTES && (found & FILE_ATTRIBUTE_DIRECTORY) != 0;
}

int rockfall_is_regular(const char *path)
{
    struct _stat64 found;

    return _stat64(path, &found) == 0 && S_ISREG(found.st_mode);
}

/* Lock out other processes by the first byte of an empty file, as Python does. No process can remove the file
   meanwhile, because Windows does not remove open files. */
int rockfall_lock(const char *path)
{
    struct _stat64 named;

    if (_stat64(path, &named) == 0 && !(S_ISREG(named.st_mode) && named.st_size == 0))
        return NO_LOCK_FILE;
    lock_file = _open(path, _O_WRONLY | _O_CREAT | _O_NOINHERIT, _S_IREAD | _S_IWRITE);
    if (lock_file < 0)
        return NOT_WRITABLE;
    if (_locking(lock_file, _LK_NBLCK, 1) != 0) {
        close_lock();
        return HELD;
    }
    snprintf(lock, sizeof lock, "%s", path);
    return TAKEN;
}

void rockfall_unlock(void)
{
    if (lock[0] == '\0')
        return;
    close_lock();
    remove(lock);
    lock[0] = '\0';
}

/* Return whether the disk of a path has this much free space; 1 if unknown. */
int rockfall_disk_holds(const char *path, int64_t bytes)
{
    char folder[4096], *name = NULL;
    ULARGE_INTEGER left;

    if (GetFullPathNameA(path, sizeof folder, folder, &name) == 0 || name == NULL)
        return 1;
    *name = '\0';
    return !GetDiskFreeSpaceExA(folder, &left, NULL, NULL) || left.QuadPart >= (ULONGLONG)bytes;
}

/* Retry for a second: virus scanners and backups keep new files open. */
int rockfall_replace(const char *from, const char *to, const char *folder)
{
    int file = _open(from, _O_RDWR), ok, tries;

    (void)folder; /* the file system writes names together with files */
    if (file < 0)
        return 0;
    ok = _commit(file) == 0;
    _close(file);
    for (tries = 0; ok && tries < 10; tries++) {
        if (MoveFileExA(from, to, MOVEFILE_REPLACE_EXISTING | MOVEFILE_WRITE_THROUGH))
            return 1;
        Sleep(100);
    }
    return 0;
}

/* Second separator of folders in paths, if the system has one, else '/'. */
char rockfall_separator(void)
{
    return '\\';
}
