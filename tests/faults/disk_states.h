/*
 * The possible contents of a disk after a power cut, made from the log of fault_io.h. The model has the guarantees of POSIX only:
 *   - the bytes of a file are safe up to its last fsync; of later writes any 512-byte sectors may be there;
 *   - the entries of a folder are safe up to the last fsync of that folder; of later changes a beginning is there. A
 *     file that was synced whose entry was not is lost; a rename between folders is there in both or in neither.
 */
#ifndef DISK_STATES_H
#define DISK_STATES_H

#include "fault_io.h"

struct disk_cut {
	size_t at;     /* entries of the log that had happened */
	uint64_t seed; /* what of the rest survives; 0: nothing, 1: all of it (as after kill -9) */
	/* Controls, which must lose data: nobody called fsync of a file, of a folder. */
	bool no_file_sync, no_folder_sync;
};
/* Makes files and folders in `path`, an empty folder. */
void disk_state_make(const struct disk_cut *, const char *path);

#endif
