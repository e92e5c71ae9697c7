#!/bin/bash
# nightly-ingest.sh FOLDER DATASET OUT: what has arrived in FOLDER goes into DATASET, and OUT/ground-DATE.ply is its ground.
#
# Run it every night, from cron or a timer, as a user who may push (group acut). Everything may go wrong: it can be killed
# at any moment, run twice at once, and run again; no file is lost, none is taken twice.
#
#   FOLDER/*.las ...      what arrived; names that begin with a dot or end in .part, .tmp or ~ are left alone
#   FOLDER/done/          files whose points are in the dataset
#   FOLDER/failed/        broken ones, each with NAME.error beside it that says what is wrong
#   OUT/ground-DATE.ply   whole, or not there; OUT/ground.ply is a link to the newest
#   FOLDER/ingest.log     a line a night
#
# Exit status, for whoever watches it (what went wrong is on standard error):
#   0    all that has arrived is in, or still arrives (a half-copied file waits, for two days at most)
#   3    the same, but a broken file was set aside
#   75   another run is at work, or the daemon was busy for too long
#   69, 74, 77, ...  as acutctl: no daemon, no space or a bad disk, not permitted. All is where it was: the next night goes on.
set -u

PAUSES=${PAUSES:-10 30 60 300 900}   # seconds between tries of what time mends
PATIENCE=${PATIENCE:-172800}         # a file that is half there for so many seconds is broken
NIGHT=${NIGHT:-$(date +%F)}

if [ $# -ne 3 ]; then
	echo "usage: nightly-ingest.sh FOLDER DATASET OUT" >&2
	exit 2
fi
folder=$1 dataset=$2 out=$3
added=0 known=0 broken=0 waiting=0

say() {
	echo "nightly-ingest: $*" >&2
}

# The line of the log, and the end. It is written with one call, so that lines do not mix.
finish() {
	echo "$(date +%FT%T) night=$NIGHT dataset=$dataset status=$1 added=$added known=$known broken=$broken waiting=$waiting ${2-}" \
		>>"$folder/ingest.log"
	exit "$1"
}

# acutctl with what follows. What time may mend is tried again: no daemon (69), a disk that is full or fails (74), busy (75),
# no answer (124). Leaves its output in $work/out and $work/err.
patient() {
	local pause status
	for pause in $PAUSES end; do
		status=0
		acutctl "$@" >"$work/out" 2>"$work/err" || status=$?
		case $status in
		69 | 74 | 75 | 124) [ "$pause" != end ] && sleep "$pause" ;;
		*) return "$status" ;;
		esac
	done
	return "$status"
}

# What the failure of the last command says, and with it the end.
give_up() {
	cat "$work/err" >&2
	say "$2 ended with $1; the next run goes on"
	finish "$1"
}

# Who a file is: another one under its name, or a change to it, is seen by it.
identity() {
	stat -c '%d:%i:%s:%y' -- "$1" 2>/dev/null
}

# Moves a file that was dealt with; but if it is not the one that acutctl has read, it goes back, for the next run.
move() {
	local file=$1 was=$2 to=$3 name
	name=$(basename -- "$file")
	if ! mv --backup=numbered -- "$file" "$to/$name"; then
		say "$name cannot be moved to $to; the next run tries again"
		finish 74
	fi
	if [ "$(identity "$to/$name")" != "$was" ]; then
		say "$name was delivered again meanwhile; the next run takes it"
		mv -n -- "$to/$name" "$file"
	fi
}

# A file alone: what becomes of it.
one() {
	local file=$1 was=$2 status=0 code
	patient push "$dataset" --checksum --replace --json -- "$file" || status=$?
	case $status in
	0)
		if grep -q '"state":"known"' "$work/out"; then known=$((known + 1)); else added=$((added + 1)); fi
		move "$file" "$was" "$folder/done"
		;;
	1)
		code=$(sed -n 's/.*"code":"\([a-z-]*\)".*/\1/p' "$work/out" | tail -n 1)
		# Half of a file, or one that grew while it was read, may still be on its way.
		if [ "$code" = truncated ] || [ "$code" = changed ]; then
			if [ $(($(date +%s) - $(stat -c %Y -- "$file" 2>/dev/null || date +%s))) -lt "$PATIENCE" ]; then
				waiting=$((waiting + 1))
				return
			fi
		fi
		broken=$((broken + 1))
		say "$(basename -- "$file") is set aside: $(tail -n 1 "$work/out")"
		cp "$work/out" "$folder/failed/$(basename -- "$file").error"
		move "$file" "$was" "$folder/failed"
		;;
	*) give_up "$status" "push of $(basename -- "$file")" ;;
	esac
}

mkdir -p -- "$folder/done" "$folder/failed" "$out" || exit 74
# One run at a time. The lock ends with the last process that has it: also an acutctl that outlives this script holds it.
exec 9>>"$folder/.lock" || exit 74
if ! flock -n 9; then
	say "another run is at work in $folder"
	exit 75
fi
work=$(mktemp -d) || exit 74
trap 'rm -rf "$work"' EXIT
trap 'exit 143' TERM INT HUP

shopt -s nullglob nocaseglob
files=() ids=()
for file in "$folder"/*.{las,laz,xyz,txt,csv}; do
	if [ -f "$file" ] && [ ! -L "$file" ]; then
		files+=("$file")
		ids+=("$(identity "$file")")
	fi
done

# All at once, which is one generation of the dataset. If one is refused, the others are in, and each is asked alone: what
# is in is known by its content.
if [ ${#files[@]} -gt 0 ]; then
	status=0
	patient push "$dataset" --checksum --replace --json -- "${files[@]}" || status=$?
	case $status in
	0)
		known=$(grep -c '"state":"known"' "$work/out")
		added=$((${#files[@]} - known))
		for i in "${!files[@]}"; do
			move "${files[i]}" "${ids[i]}" "$folder/done"
		done
		;;
	1 | 3)
		fresh=$(grep -c '"state":"\(staged\|adopted\)"' "$work/out")
		for i in "${!files[@]}"; do
			one "${files[i]}" "${ids[i]}"
		done
		known=$((known - fresh)) added=$((added + fresh)) # the second time they were known
		;;
	*) give_up "$status" push ;;
	esac
fi

# The ground as of now. The same mesh as before is not made again, and acutctl gives the file its name when it is whole.
status=0
patient submit "$dataset" --ground --wait --json || status=$?
if [ "$status" -eq 4 ]; then
	finish $((broken ? 3 : 0)) mesh=none # nothing good has ever arrived
fi
[ "$status" -eq 0 ] || give_up "$status" submit
job=$(sed -n 's/.*"job":\([0-9]*\).*/\1/p' "$work/out")
digest=$(sed -n 's/.*"digest":"\([0-9a-f]*\)".*/\1/p' "$work/out")
patient fetch "$job" -o "$out/ground-$NIGHT.ply" || give_up $? fetch
ln -sfn -- "ground-$NIGHT.ply" "$out/ground.ply"
finish $((broken ? 3 : 0)) "job=$job digest=$digest mesh=ground-$NIGHT.ply"
