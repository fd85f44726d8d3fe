/* SPDX-License-Identifier: Apache-2.0 */
/* Preloaded into a node: its clock is set, its main thread stalls, its disk is slow, as a file says, or it has no locks. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* Seconds that the clock is ahead; milliseconds for which the main thread is to stall, once, and that
   an fsync takes. */
static volatile int64_t *orders;

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("SHIM_ORDERS");
    int file = path ? open(path, O_RDWR) : -1;
    if (file >= 0) {
        void *found = mmap(0, 24, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        orders = found == MAP_FAILED ? 0 : found;
        close(file);
    }
}

int clock_gettime(clockid_t clock, struct timespec *when) {
    if (orders && orders[1] && syscall(SYS_gettid) == getpid()) {
        int64_t stall = orders[1];
        orders[1] = 0;
        usleep(stall * 1000);
    }
    int failed = syscall(SYS_clock_gettime, clock, when);
    if (!failed && clock == CLOCK_REALTIME && orders) when->tv_sec += orders[0];
    return failed;
}

int gettimeofday(struct timeval *restrict when, void *restrict zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    when->tv_sec = now.tv_sec;
    when->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *where) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (where) *where = now.tv_sec;
    return now.tv_sec;
}

static int slow(const char *name, int file) {
    if (orders && orders[2]) usleep(orders[2] * 1000);
    return ((int (*)(int))dlsym(RTLD_NEXT, name))(file);
}

int fsync(int file) { return slow("fsync", file); }
int fdatasync(int file) { return slow("fdatasync", file); }

/* A file system without locks, as some network file systems are. */
int flock(int file, int operation) {
    if (getenv("SHIM_NO_LOCKS")) {
        errno = ENOLCK;
        return -1;
    }
    return syscall(SYS_flock, file, operation);
}

/* The kernel's clock stays: a deadline by the clock that was set is one of another time. */
int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict until) {
    static int (*wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    struct timespec deadline = *until;
    if (!wait) wait = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");  /* x86_64 */
    if (!wait) wait = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    if (orders && deadline.tv_sec > 1000000000) deadline.tv_sec -= orders[0];
    return wait(condition, mutex, &deadline);
}
