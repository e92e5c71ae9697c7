#!/bin/sh
# copy-storage.sh DEVICE FOLDER: copies the LAS, LAZ and text files of a disk into a drop folder of acut (acut-ingest(8)); run by
# acut-storage@.service. The disk is mounted read-only. A file has its place on the disk in its name, and appears under it when it is whole;
# one that was delivered before is not copied again. Another one of the same name (counters of scanners begin anew) has its checksum behind it.
set -eu
device=$1 folder=$2
at=${MOUNT_POINT:-/mnt}
mount -o ro,nosuid,nodev,noexec "$device" "$at"
cd "$at"

# delivered NAME: 0: a file of this name was; its path stands in $there.
delivered() {
	for there in "$folder/$1" "$folder/done/$1" "$folder/failed/$1"; do
		[ ! -e "$there" ] || return 0
	done
	return 1
}

find . -xdev -type f \( -iname '*.las' -o -iname '*.laz' -o -iname '*.xyz' \) ! -name '.*' | while IFS= read -r file; do
	name=$(printf '%s' "${file#./}" | tr / _)
	if delivered "$name"; then
		! cmp -s -- "$file" "$there" || continue
		name=${name%.*}-$(cksum <"$file" | cut -d' ' -f1).${name##*.}
		! delivered "$name" || continue
	fi
	cp -- "$file" "$folder/.$name.part"
	mv -n -- "$folder/.$name.part" "$folder/$name"
	echo "copied $name"
done
