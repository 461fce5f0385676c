/* QEMU plugin: how often each block of straight code ran.
 *
 *   qemu-arm -plugin blocks.so,code=ADDRESS,frame=ADDRESS PROGRAM...
 *
 * CODE is where the program's code begins, FRAME the function that begins a frame, both in hex as nm and readelf print them; counting
 * begins with the first frame. At the end it writes a line "ADDRESS INSTRUCTIONS COUNT" per block and "frames COUNT" to the file named
 * by $COUNTS. One thread only. Build: gcc -shared -fPIC -O2 -o blocks.so blocks.c */
#include "../instructions/plugin.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Open addressing; a block that is translated again has the same place. */
enum { BLOCKS = 1 << 18 };
static struct { uint64_t address, size, count; } blocks[BLOCKS];
static uint64_t code, frame, frames, lost;

static void begun(unsigned vcpu, void *unused)
{
    if (!frames++)
        for (unsigned i = 0; i < BLOCKS; i++)
            blocks[i].count = 0;
}

static uint64_t *find(uint64_t address, uint64_t size)
{
    for (unsigned i = (address * 0x9e3779b97f4a7c15 + size) >> 46, n = 0; n < BLOCKS; i = (i + 1) % BLOCKS, n++) {
        if (!blocks[i].size) {
            blocks[i].address = address;
            blocks[i].size = size;
        }
        if (blocks[i].address == address && blocks[i].size == size)
            return &blocks[i].count;
    }
    return &lost;
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    uint64_t address = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(tb, 0)) - (qemu_plugin_start_code() - code);
    if (address == frame)
        qemu_plugin_register_vcpu_tb_exec_cb(tb, begun, QEMU_PLUGIN_CB_NO_REGS, NULL);
    qemu_plugin_register_vcpu_tb_exec_inline(tb, QEMU_PLUGIN_INLINE_ADD_U64, find(address, qemu_plugin_tb_n_insns(tb)), 1);
}

static void ended(qemu_plugin_id_t id, void *unused)
{
    const char *path = getenv("COUNTS");
    FILE *f = path ? fopen(path, "w") : NULL;
    if (!f)
        return;
    for (unsigned i = 0; i < BLOCKS; i++)
        if (blocks[i].count)
            fprintf(f, "%llx %llu %llu\n", (unsigned long long)blocks[i].address, (unsigned long long)blocks[i].size,
                    (unsigned long long)blocks[i].count);
    fprintf(f, "frames %llu\n", (unsigned long long)frames);
    fclose(f);
}

__attribute__((visibility("default"))) int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv)
{
    for (int i = 0; i < argc; i++) {
        if (!strncmp(argv[i], "code=", 5))
            code = strtoull(argv[i] + 5, NULL, 16);
        else if (!strncmp(argv[i], "frame=", 6))
            frame = strtoull(argv[i] + 6, NULL, 16);
    }
    if (argc != 2 || !frame) {
        fprintf(stderr, "blocks.so: expected code=ADDRESS,frame=ADDRESS in hex\n");
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
