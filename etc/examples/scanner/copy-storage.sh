#!/bin/sh
# copy-storage.sh DEVICE FOLDER: copies the LAS, LAZ and text files of a disk into a drop folder of acut (acut-ingest(8)); run by
# acut-storage@.service. The disk is mounted read-only. A file has its place on the disk in its name, and appears under it when it is whole;
# one that was delivered before is not copied again.
set -eu
device=$1 folder=$2
mount -o ro,nosuid,nodev,noexec "$device" /mnt
cd /mnt
find . -xdev -type f \( -iname '*.las' -o -iname '*.laz' -o -iname '*.xyz' \) ! -name '.*' | while IFS= read -r file; do
	name=$(printf '%s' "${file#./}" | tr / _)
	if [ -e "$folder/$name" ] || [ -e "$folder/done/$name" ] || [ -e "$folder/failed/$name" ]; then
		continue
	fi
	cp -- "$file" "$folder/.$name.part"
	mv -n -- "$folder/.$name.part" "$folder/$name"
	echo "copied $name"
done
