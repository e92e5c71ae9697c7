#!/bin/sh
# The shared library exports what acut.h declares, and nothing else.
set -eu
want=$(grep -oE '\bacut_[a-z_]+\(' "$2" | tr -d '(' | sort -u)
have=$(nm -D --defined-only "$1" | awk '$2 != "A" { sub(/@.*/, "", $3); print $3 }' | sort -u)
if [ "$want" != "$have" ]; then
	echo "acut.h declares:" $want
	echo "libacut exports:" $have
	exit 1
fi
