/* SPDX-License-Identifier: BSD-3-Clause */
/* For LD_PRELOAD: counts the calls by which a process writes files to disk and renames them. Before
   the n-th call it ends the process (CRASH_AT=n), interrupts it (INTERRUPT_AT=n), or lets it hang
   as on a dead disk (STALL_AT=n). INTERRUPT_READY=n interrupts the process when it sets its n-th
   handler of Ctrl-C. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

static atomic_long steps, handlers;

static int is(const char *name, long count) {
    const char *at = getenv(name);
    return at && atol(at) == count;
}

/* Nothing is counted in a process that only forks others. */
static int counts(void) {
    return getenv("CRASH_AT") || getenv("INTERRUPT_AT") || getenv("STALL_AT") || getenv("INTERRUPT_READY");
}

static void step(void) {
    if (!counts()) return;
    long count = ++steps;
    if (is("CRASH_AT", count)) _exit(137);
    if (is("INTERRUPT_AT", count)) kill(getpid(), SIGINT);
    if (is("STALL_AT", count)) for (;;) sleep(1);
}

#define STEP(name, parameters, arguments)                             \
    int name parameters {                                             \
        int (*next) parameters = dlsym(RTLD_NEXT, #name);             \
        step();                                                       \
        return next arguments;                                        \
    }

STEP(rename, (const char *from, const char *to), (from, to))
STEP(unlink, (const char *path), (path))
STEP(flock, (int descriptor, int operation), (descriptor, operation))

/* Written data outlives a process, so there is no need to wait for the disk. */
int fsync(int descriptor) {
    (void)descriptor;
    step();
    return 0;
}

static void ready(int number) {
    if (number == SIGINT && counts() && is("INTERRUPT_READY", ++handlers)) kill(getpid(), SIGINT);
}

int sigaction(int number, const struct sigaction *action, struct sigaction *before) {
    int (*next)(int, const struct sigaction *, struct sigaction *) = dlsym(RTLD_NEXT, "sigaction");
    int status = next(number, action, before);
    if (action) ready(number);
    return status;
}

sighandler_t signal(int number, sighandler_t handler) {
    sighandler_t (*next)(int, sighandler_t) = dlsym(RTLD_NEXT, "signal");
    sighandler_t before = next(number, handler);
    ready(number);
    return before;
}
