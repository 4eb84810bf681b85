/* Power fails between two writes: LD_PRELOAD counts what a program does to the files under the folder NADIR_DIE_IN (create,
   write, sync, rename, remove) and kills it (SIGKILL) at the step NADIR_DIE_AT, counted from 1. Of a write that it dies in,
   half is written. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static atomic_int steps;

static int inside(const char* path) {
  const char* folder = getenv("NADIR_DIE_IN");
  return folder && path && strncmp(path, folder, strlen(folder)) == 0;
}

static int inside_fd(int fd) {
  char link[64], path[4096];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t size = readlink(link, path, sizeof path - 1);
  if (size < 0) return 0;
  path[size] = 0;
  return inside(path);
}

static int dies_now(void) {
  const char* at = getenv("NADIR_DIE_AT");
  return at && atomic_fetch_add(&steps, 1) + 1 == atoi(at);
}

static void die(void) {
  kill(getpid(), SIGKILL);
  for (;;) pause();
}

#define REAL(name, type, ...) \
  static type (*real)(__VA_ARGS__) = 0; \
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, name)

static int opened(int (*real)(const char*, int, ...), const char* path, int flags, mode_t mode) {
  if ((flags & O_CREAT) && inside(path) && dies_now()) die();
  return real(path, flags, mode);
}

int open(const char* path, int flags, ...) {
  REAL("open", int, const char*, int, ...);
  va_list more;
  va_start(more, flags);
  mode_t mode = ((flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return opened(real, path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  REAL("open64", int, const char*, int, ...);
  va_list more;
  va_start(more, flags);
  mode_t mode = ((flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return opened(real, path, flags, mode);
}

ssize_t write(int fd, const void* bytes, size_t size) {
  REAL("write", ssize_t, int, const void*, size_t);
  if (inside_fd(fd) && dies_now()) {
    real(fd, bytes, size / 2);
    die();
  }
  return real(fd, bytes, size);
}

int fsync(int fd) {
  REAL("fsync", int, int);
  if (inside_fd(fd) && dies_now()) die();
  return real(fd);
}

static int inside_at(int folder, const char* path) {
  return path[0] == '/' || folder == AT_FDCWD ? inside(path) : inside_fd(folder);
}

int openat(int folder, const char* path, int flags, ...) {
  REAL("openat", int, int, const char*, int, ...);
  va_list more;
  va_start(more, flags);
  mode_t mode = ((flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE) ? va_arg(more, mode_t) : 0;
  va_end(more);
  if ((flags & O_CREAT) && inside_at(folder, path) && dies_now()) die();
  return real(folder, path, flags, mode);
}

int linkat(int from_folder, const char* from, int folder, const char* to, int flags) {
  REAL("linkat", int, int, const char*, int, const char*, int);
  if (inside_at(folder, to) && dies_now()) die();
  return real(from_folder, from, folder, to, flags);
}

int renameat(int from_folder, const char* from, int folder, const char* to) {
  REAL("renameat", int, int, const char*, int, const char*);
  if (inside_at(folder, to) && dies_now()) die();
  return real(from_folder, from, folder, to);
}

int renameat2(int from_folder, const char* from, int folder, const char* to, unsigned flags) {
  REAL("renameat2", int, int, const char*, int, const char*, unsigned);
  if (inside_at(folder, to) && dies_now()) die();
  return real(from_folder, from, folder, to, flags);
}

int unlinkat(int folder, const char* path, int flags) {
  REAL("unlinkat", int, int, const char*, int);
  if (inside_at(folder, path) && dies_now()) die();
  return real(folder, path, flags);
}

int rename(const char* from, const char* to) {
  REAL("rename", int, const char*, const char*);
  if (inside(to) && dies_now()) die();
  return real(from, to);
}

int unlink(const char* path) {
  REAL("unlink", int, const char*);
  if (inside(path) && dies_now()) die();
  return real(path);
}

int remove(const char* path) {
  REAL("remove", int, const char*);
  if (inside(path) && dies_now()) die();
  return real(path);
}
