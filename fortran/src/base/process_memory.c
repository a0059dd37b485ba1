/* SPDX-License-Identifier: BSD-3-Clause */
/* Stack size of the current thread, and whether the process can map more memory, on Linux, macOS and Windows. */
#define _GNU_SOURCE
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#if defined(_WIN32)
#include <windows.h>
#else
#include <pthread.h>
#include <sys/mman.h>
#endif
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__linux__)
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

/* Stack size of the calling thread in bytes; 0 if unknown. */
int64_t rockfall_stack(void)
{
#if defined(_WIN32)
    ULONG_PTR low, high;

    GetCurrentThreadStackLimits(&low, &high);
    return (int64_t)(high - low);
#elif defined(__APPLE__)
    return (int64_t)pthread_get_stacksize_np(pthread_self());
#else
    pthread_attr_t attributes;
    size_t bytes = 0;

#if defined(__linux__) /* main thread: pthread_getattr_np would parse all mappings of the process, in milliseconds */
    struct rlimit limit;

    if (syscall(SYS_gettid) == getpid() && getrlimit(RLIMIT_STACK, &limit) == 0)
        return limit.rlim_cur > INT64_MAX ? 0 : (int64_t)limit.rlim_cur;
#endif
    if (pthread_getattr_np(pthread_self(), &attributes) != 0)
        return 0;
    if (pthread_attr_getstacksize(&attributes, &bytes) != 0)
        bytes = 0;
    pthread_attr_destroy(&attributes);
    return bytes > INT64_MAX ? INT64_MAX : (int64_t)bytes;
#endif
}

/* Take memory for all threads from one arena if the address space or the data of the process is limited (ulimit -v,
   -d); otherwise the C library reserves 64 MB or more for each thread. Returns 1 if there is a limit. */
int rockfall_spare_arenas(void)
{
#if defined(__GLIBC__)
    struct rlimit space, data;

    if (getrlimit(RLIMIT_AS, &space) == 0 && getrlimit(RLIMIT_DATA, &data) == 0 &&
        (space.rlim_cur != RLIM_INFINITY || data.rlim_cur != RLIM_INFINITY))
        return mallopt(M_ARENA_MAX, 1);
#endif
    return 0;
}

/* Replaces the procedure of libgfortran that is called if an allocation without `stat` fails: prints one line and exits
   with the status of a case that is too large. */
void _gfortran_os_error_at(const char *place, const char *format, ...)
{
    static const char line[] = "rockfall: not enough memory for this case: use fewer threads, or raise ulimit -v\n";

    (void)place, (void)format;
    fflush(stdout);
    fputs(line, stderr);
    _Exit(2);
}

/* Return whether the process can map `bytes` more bytes; the mapping is released. */
int rockfall_fits(int64_t bytes)
{
#if defined(_WIN32)
    void *at = VirtualAlloc(NULL, (SIZE_T)bytes, MEM_RESERVE, PAGE_NOACCESS);

    return at != NULL && VirtualFree(at, 0, MEM_RELEASE);
#else
    void *at = mmap(NULL, (size_t)bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANON | MAP_NORESERVE, -1, 0);

    return at != MAP_FAILED && munmap(at, (size_t)bytes) == 0;
#endif
}

/* Allocate zeroed memory lazily, in huge pages as NumPy does, because boulders access cells at random.
   NULL if out of memory. */
void *rockfall_zeros(int64_t n, int64_t size)
{
    char *block = calloc((size_t)n, (size_t)size);
#ifdef MADV_HUGEPAGE
    const uintptr_t page = 4096;
    uintptr_t bytes = (uintptr_t)n * (uintptr_t)size, begin = ((uintptr_t)block + page - 1) / page * page;

    if (block != NULL && bytes >= 1 << 22)
        madvise((void *)begin, (uintptr_t)block + bytes - begin, MADV_HUGEPAGE);
#endif
    return block;
}
