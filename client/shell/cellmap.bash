# Bash completion for cellmap and cellmapd: verbs, flags and their values as the installed programs tell them.

_cellmap_help() { "$@" --help 2>/dev/null; }

# The names of a help text's section, such as "Subcommands:".
_cellmap_section() { sed -n "/^$1:/,/^\$/p" | sed -n 's/^  \([a-z][a-z-]*\) .*/\1/p'; }

# All flags of a help text; the values of one flag, where the help lists them as {a,b}.
_cellmap_flags() { sed -nE 's/^ +(-[a-zA-Z],)?(--[a-z-]+).*/\2/p'; }
_cellmap_values() { sed -nE "s/^ +(-[a-zA-Z],)?$1 [^ ]*\{([^}]+)\}.*/\2/p" | tr ',' ' '; }

_cellmap() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} word program=(${COMP_WORDS[0]}) help
  COMPREPLY=()
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    [[ $word == [a-z]* ]] && _cellmap_help "${program[@]}" | _cellmap_section Subcommands | grep -qx -e "$word" && program+=("$word")
  done
  help=$(_cellmap_help "${program[@]}")
  if [[ $previous == --* ]]; then
    local values
    values=$(_cellmap_values "$previous" <<<"$help")
    [[ -n $values ]] && { mapfile -t COMPREPLY < <(compgen -W "$values" -- "$current"); return; }
  fi
  if [[ $current == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$(_cellmap_flags <<<"$help")" -- "$current")
    return
  fi
  local verbs
  verbs=$(_cellmap_section Subcommands <<<"$help")
  if [[ -n $verbs ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$verbs" -- "$current")
  else
    mapfile -t COMPREPLY < <(compgen -f -- "$current")
  fi
}

complete -o filenames -F _cellmap cellmap
complete -o filenames -F _cellmap cellmapd
