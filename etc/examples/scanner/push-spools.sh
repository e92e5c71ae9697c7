#!/bin/sh
# push-spools.sh SPOOLS POSES DATASET [OPTION...]: pushes the spools of a folder that have a pose file into a dataset; run
# by acut-scan-push.timer, or by hand. Of SPOOLS/NAME.spool the pose file is POSES/NAME.csv: who computes poses copies them there
# under another name and renames them. OPTIONs are those of acut-scan push (--pose-clock gps, --gap 0.5). With POSES "-" spools are pushed without:
# for scanners that send points themselves (LAS, XYZ).
#
# Spools are only read. A spool that is in the dataset is not pushed twice, however often this runs: acut-scan push sees to it; the
# marks in STATE_DIRECTORY (or ./pushed) only save the time. A spool that is still being written is left for the next time; one that has
# grown since, or whose poses are newer, is pushed again: with --replace among the OPTIONs it takes the place of what was there, else it is
# refused and said so.
set -u
spools=$1 poses=$2 dataset=$3
shift 3
marks=${STATE_DIRECTORY:-pushed}
mkdir -p "$marks" || exit 1
worst=0
for spool in "$spools"/*.spool; do
	[ -f "$spool" ] || continue
	name=$(basename "$spool" .spool)
	mark=$marks/$name.$dataset pose=$poses/$name.csv
	[ -f "$pose" ] || pose=$spool
	if [ -e "$mark" ] && [ -z "$(find "$spool" "$pose" -newer "$mark")" ]; then
		continue
	fi
	# Written to within the last five minutes: its scanner is plugged in.
	[ -z "$(find "$spool" -mmin -"${SETTLE_MINUTES:-5}")" ] || continue
	begun=$marks/.begun.$name.$dataset
	: >"$begun"
	if [ "$poses" = - ]; then
		acut-scan push "$spool" --into "$dataset" --quiet "$@"
	else
		[ "$pose" != "$spool" ] || continue
		acut-scan push "$spool" --pose "$pose" --into "$dataset" --quiet "$@"
	fi
	status=$?
	case $status in
	0) mv -- "$begun" "$mark" ;; # of the time before: what came meanwhile is newer
	69 | 75) exit "$status" ;; # acutd is away or busy: time mends it, for the others too
	*) echo "push-spools: $spool was refused ($status)" >&2; worst=$status ;;
	esac
done
exit "$worst"
