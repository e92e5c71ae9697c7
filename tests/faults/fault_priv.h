/* What fault_io.c and fault_sql.c share. All between fault_lock and fault_unlock. */
#ifndef FAULT_PRIV_H
#define FAULT_PRIV_H

#include "fault_io.h"

void fault_sql_start(void);
void fault_lock(void);
void fault_unlock(void);
bool fault_fails(enum fault_call); /* counts it; true with errno */
bool fault_half(void);
int fault_error(void);
void fault_did_create(int dirfd, const char *path, bool folder, bool cut);
void fault_did_unlink(int dirfd, const char *path);
void fault_did_sync_dir_of(const char *path);
unsigned fault_node_at(const char *path); /* ~0u: not below the root */
void fault_did_write_node(unsigned node, const void *buf, size_t n, uint64_t at);
void fault_did_size_node(unsigned node, uint64_t size);
void fault_did_sync_node(unsigned node);

#endif
