# shellcheck shell=bash
# Set-up shared by ./quickstart, ./check and .ci/run: packages, configure, build. Sourced, not run.

say() { printf '%s\n' "acut: $*" >&2; }
die() { say "$*"; exit 1; }

as_root() {
	if [ "$(id -u)" = 0 ]; then
		"$@"
	elif command -v sudo >/dev/null; then
		sudo "$@"
	else
		die "these packages are missing, and neither root nor sudo is there to install them:$missing"
	fi
}

# wanted_packages KIND...: names from build-aux/packages.
wanted_packages() {
	local kinds=" $* " kind name
	while IFS=$'\t' read -r kind name; do
		case "$kind" in ''|\#*) continue ;; esac
		case "$kinds" in *" $kind "*) printf '%s\n' "$name" ;; esac
	done <build-aux/packages
}

# find_missing KIND...: puts the packages that are missing into $missing.
find_missing() {
	local names name installed
	command -v dpkg-query >/dev/null ||
		die "this set-up knows Debian packages only; install those of build-aux/packages by hand"
	names=$(wanted_packages "$@")
	# Its status is that of names it does not know.
	# shellcheck disable=SC2086
	installed=$(dpkg-query -W -f='${Package}:${Status}\n' $names 2>/dev/null | sed -n 's/:[a-z]* ok installed$//p') || true
	missing=""
	for name in $names; do
		grep -qxF -e "$name" <<<"$installed" || missing="$missing $name"
	done
}

# install_packages KIND...: what is missing of them, and nothing else.
install_packages() {
	find_missing "$@"
	[ -n "$missing" ] || return 0
	say "installing packages:$missing"
	as_root apt-get -o Acquire::Retries=4 update -qq || die "apt-get update failed"
	# shellcheck disable=SC2086
	as_root env DEBIAN_FRONTEND=noninteractive apt-get -o Acquire::Retries=4 install -y -qq --no-install-recommends $missing \
		2> >(grep -v '^debconf: delaying package configuration' >&2) >/dev/null ||
		die "apt-get could not install:$missing"
}

# configure DIR [MESON OPTION...]: once.
configure() {
	local dir=$1 log
	shift
	[ -f "$dir/build.ninja" ] && return 0
	rm -rf "$dir"
	mkdir -p "$dir"
	log=$(meson setup "$dir" "$@" 2>&1) || { printf '%s\n' "$log" >&2; rm -rf "$dir"; die "configuring failed"; }
}

# build DIR [TARGET...]: a line for each tenth. The output of the compilers is in DIR/build.log.
build() {
	local dir=$1
	shift
	ninja -C "$dir" "$@" 2>&1 | tee "$dir/build.log" |
		awk -F '[][/]' '/^\[[0-9]+\// { t = int(10 * $2 / $3); if (t > last) { last = t; print "acut: built " t "0 %"; fflush() } }' >&2 ||
		{ tail -n 60 "$dir/build.log" >&2; die "building failed, see $dir/build.log"; }
}
