#!/bin/sh
# journalctl compiles the catalogue of messages and has every entry of it: catalog.sh JOURNALCTL CATALOG
set -eu
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/usr/lib/systemd/catalog" "$root/var/lib/systemd/catalog"
cp "$2" "$root/usr/lib/systemd/catalog/acut.catalog"
"$1" --root="$root" --update-catalog
want=$(grep -c '^-- ' "$2")
got=$("$1" --root="$root" --list-catalog | grep -c '^[0-9a-f]\{32\} acut: ')
if [ "$want" -ne "$got" ]; then
	echo "journalctl knows $got of $want entries"
	exit 1
fi
"$1" --root="$root" --dump-catalog d6d1513041a8411d9aa9fdb3165d0a83 | grep -q '^Subject: a job failed$'
echo "$got entries"
