/* QEMU plugin: instructions executed, by part of the program.
 *
 *   qemu-arm -plugin count.so,table=FILE PROGRAM...      FILE: lines "START END NAME", hex addresses as nm prints them, sorted
 *
 * FILE begins with "code ADDRESS frame ADDRESS": where the program's code begins, and the function that begins a frame; counting
 * begins with the first. At the end it writes one line "NAME COUNT" per name, "other COUNT" and "frames COUNT" to the file named by
 * $COUNTS. One thread only: the inline addition is not atomic.
 * Build: gcc -shared -fPIC -O2 -o count.so count.c */
#include "plugin.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RANGES = 1 << 16, NAMES = 32 };
static struct { uint64_t start, end; unsigned name; } ranges[RANGES];
static unsigned range_count, name_count = 1;
static char names[NAMES][32] = { "other" };
static uint64_t counts[NAMES], code, start_of_frame, frames;

static unsigned name_of(const char *name)
{
    for (unsigned i = 0; i < name_count; i++)
        if (!strcmp(names[i], name))
            return i;
    if (name_count == NAMES)
        return 0;
    snprintf(names[name_count], sizeof names[0], "%s", name);
    return name_count++;
}

/* The first line holds the address of the program's code, from which its place in memory follows, and that of the function that
 * begins a frame. */
static bool read_table(const char *path)
{
    FILE *f = fopen(path, "r");
    unsigned long long start, end;
    char name[32];
    if (!f || fscanf(f, "code %llx frame %llx", &start, &end) != 2)
        return false;
    code = start;
    start_of_frame = end;
    while (range_count < RANGES && fscanf(f, "%llx %llx %31s", &start, &end, name) == 3) {
        ranges[range_count].start = start;
        ranges[range_count].end = end;
        ranges[range_count++].name = name_of(name);
    }
    fclose(f);
    return range_count > 0;
}

static unsigned find(uint64_t address)
{
    unsigned low = 0, high = range_count;
    while (low < high) {
        unsigned middle = (low + high) / 2;
        if (ranges[middle].end <= address)
            low = middle + 1;
        else
            high = middle;
    }
    return low < range_count && ranges[low].start <= address ? ranges[low].name : 0;
}

/* Counting begins with the first frame: what comes before is another program's business. */
static void begun(unsigned vcpu, void *unused)
{
    if (!frames++)
        memset(counts, 0, sizeof counts);
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    uint64_t offset = qemu_plugin_start_code() - code;
    size_t n = qemu_plugin_tb_n_insns(tb);
    struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, 0);
    uint64_t address = qemu_plugin_insn_vaddr(insn) - offset;
    if (address == start_of_frame)
        qemu_plugin_register_vcpu_tb_exec_cb(tb, begun, QEMU_PLUGIN_CB_NO_REGS, NULL);
    /* A block of straight code lies in one function. */
    qemu_plugin_register_vcpu_tb_exec_inline(tb, QEMU_PLUGIN_INLINE_ADD_U64, &counts[find(address)], n);
}

static void ended(qemu_plugin_id_t id, void *unused)
{
    const char *path = getenv("COUNTS");
    FILE *f = path ? fopen(path, "w") : stderr;
    for (unsigned i = 0; f && i < name_count; i++)
        fprintf(f, "%s %llu\n", names[i], (unsigned long long)counts[i]);
    if (f) {
        fprintf(f, "frames %llu\n", (unsigned long long)frames);
        fclose(f);
    }
}

__attribute__((visibility("default"))) int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv)
{
    if (argc != 1 || strncmp(argv[0], "table=", 6) || !read_table(argv[0] + 6)) {
        fprintf(stderr, "count.so: expected table=FILE, a readable table\n");
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
