/* Shared by fault_io.c, fault_log.c and fault_sql.c. All functions but fault_lock and fault_sql_start are called with the lock.
 */
#ifndef FAULT_PRIV_H
#define FAULT_PRIV_H

#include "fault_io.h"

enum { FAULT_NO_NODE = ~0u };

void fault_sql_start(void);
void fault_lock(void);
void fault_unlock(void);
bool fault_fails(enum fault_call); /* counts it; true with errno */
bool fault_half(void);
int fault_error(void);
void fault_did_create(int dirfd, const char *path, bool folder, bool cut);
void fault_did_unlink(int dirfd, const char *path);
void fault_did_sync_dir_of(const char *path);
void fault_did_rename(int olddir, const char *old, int newdir, const char *name);
void fault_did_link(int olddir, const char *old, int newdir, const char *name);
unsigned fault_node_at(const char *path); /* FAULT_NO_NODE: not below the root */
unsigned fault_node_of(int fd);           /* FAULT_NO_NODE: it is not logged */
void fault_did_write_node(unsigned node, const void *buf, size_t n, uint64_t at);
void fault_did_size_node(unsigned node, uint64_t size);
void fault_did_sync_node(unsigned node);
void fault_lose(unsigned node); /* its fsync failed */
void fault_use(unsigned node);  /* it is named or synced again: counted for fault_distrusted if its fsync failed */
void fault_trust_all(void);     /* sets that count to zero */

#endif
