# completion of benchctl for zsh
_benchctl() {
    local line text says
    local -a whole part
    for line in "${(@f)$(_BENCHCTL_COMPLETE=zsh _BENCHCTL_WORD="${(Q)PREFIX}" \
        "${words[1]}" "${(@Q)words[2,CURRENT-1]}" 2>/dev/null)}"; do
        [[ -n $line ]] || continue
        text=${line%%$'\t'*} says=${line#*$'\t'}
        text=${text//:/\\:}
        [[ -z $says ]] || says=:$says
        if [[ $text == */ || $text == *= ]]; then part+=("$text$says"); else whole+=("$text$says"); fi
    done
    (( $#whole + $#part )) || { _files; return }
    (( ! $#whole )) || _describe -V benchctl whole
    (( ! $#part )) || _describe -V benchctl part -S ''
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit -i }
compdef _benchctl benchctl
