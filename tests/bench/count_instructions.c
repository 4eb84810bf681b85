/* A plug-in of qemu: the instructions that a program has executed, on all of its threads, into the file that `out` names.
 * Debian has qemu with plug-ins, but not their header: below is what of its interface (version 1) is used here.
 *
 *   qemu-aarch64 -plugin count_instructions.so,out=FILE -L SYSROOT PROGRAM */
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, void (*translated)(qemu_plugin_id_t, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *block, void (*executed)(unsigned int, void *), int registers, void *data);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, void (*ended)(qemu_plugin_id_t, void *), void *data);

int qemu_plugin_version = 1;

/* Each thread is a processor of qemu's and counts for itself, on its own line of the cache. */
enum { MOST_THREADS = 1024 };
static struct {
  uint64_t count;
  uint64_t fill[7];
} threads[MOST_THREADS];
static char path[4096];

static void executed(unsigned int thread, void *instructions) {
  threads[thread % MOST_THREADS].count += (uintptr_t)instructions;
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb *block) {
  (void)id;
  qemu_plugin_register_vcpu_tb_exec_cb(block, executed, 0, (void *)(uintptr_t)qemu_plugin_tb_n_insns(block));
}

static void ended(qemu_plugin_id_t id, void *data) {
  (void)id;
  (void)data;
  uint64_t sum = 0;
  for (int i = 0; i < MOST_THREADS; ++i) sum += threads[i].count;
  FILE *out = fopen(path, "w");
  if (out == NULL) return;
  fprintf(out, "%" PRIu64 "\n", sum);
  fclose(out);
}

int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv) {
  (void)info;
  if (argc != 1 || strncmp(argv[0], "out=", 4) != 0) {
    fputs("count_instructions: usage: -plugin count_instructions.so,out=FILE\n", stderr);
    return -1;
  }
  snprintf(path, sizeof path, "%s", argv[0] + 4);
  qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
  qemu_plugin_register_atexit_cb(id, ended, NULL);
  return 0;
}
