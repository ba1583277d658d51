# completion of benchctl for bash
_benchctl_complete() {
    local reply
    COMPREPLY=()
    while IFS= read -r reply; do
        COMPREPLY+=("$reply")
    done < <(_BENCHCTL_COMPLETE=bash _BENCHCTL_LINE="${COMP_LINE:0:COMP_POINT}" "$1" 2>/dev/null)
    [[ ${#COMPREPLY[@]} -gt 0 ]] || compopt +o nospace 2>/dev/null
}
complete -o default -o nospace -F _benchctl_complete benchctl
