/* The plane of a push: from the dataset, --crs, or the poses. */
#ifndef SCAN_PUSH_PLANE_H
#define SCAN_PUSH_PLANE_H

#include "ground.h"
#include "scan.h"

/* The dataset as it is before the push. */
struct scan_target {
	bool there, empty; /* empty: it has no generation yet */
	char crs[CRS_TEXT_SIZE], unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];
};
struct scan_plane {
	struct crs_info to, degrees;
	bool has_to, has_degrees;
};
/* -ERR_USAGE, -ERR_INPUT: they contradict each other. */
int scan_push_plane(struct program *, const struct scan_target *, struct scan_plane *ret, struct err *);
/* The poses on that plane; `fd` stays open with the track. */
int scan_push_poses(struct program *, const struct scan_plane *, int fd, struct pose_track **ret, struct err *);

#endif
