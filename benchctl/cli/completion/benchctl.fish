# completion of benchctl for fish
function __benchctl_complete
    set -l word (commandline -ct)
    set -l found (env _BENCHCTL_COMPLETE=fish _BENCHCTL_WORD="$word" (commandline -opc) 2>/dev/null)
    if set -q found[1]
        printf '%s\n' $found
    else
        __fish_complete_path "$word"
    end
end
complete --command benchctl --no-files --keep-order --arguments '(__benchctl_complete)'
