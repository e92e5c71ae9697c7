# bash completion of acut-scan. What there is to complete acut-scan itself knows ("acut-scan complete", out of its tables).

_acut_scan_files()
{
	local cur=$1 pattern
	shift
	pattern=$(IFS='|'; printf '%s' "${*#.}")
	if declare -F _filedir >/dev/null; then
		_filedir ${pattern:+"@($pattern)"}
		return
	fi
	compopt -o filenames 2>/dev/null
	mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -- "$cur")
}

_acut_scan()
{
	local cur=${COMP_WORDS[COMP_CWORD]} line
	local -a kinds
	COMPREPLY=()
	[[ $cur == = ]] && cur=
	while IFS= read -r line; do
		case $line in
		:folders)
			if declare -F _filedir >/dev/null; then
				_filedir -d
			else
				compopt -o filenames 2>/dev/null
				mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -d -- "$cur")
			fi
			;;
		:files*)
			read -r -a kinds <<<"${line#:files}"
			_acut_scan_files "$cur" "${kinds[@]}"
			;;
		*)
			COMPREPLY+=("$(printf '%q' "${line%%$'\t'*}")")
			;;
		esac
	done < <("${COMP_WORDS[0]/#\~/$HOME}" complete "$COMP_CWORD" "${COMP_WORDS[@]}" 2>/dev/null)
}

complete -F _acut_scan acut-scan
