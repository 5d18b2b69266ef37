#!/usr/bin/env bash
# A rig from training data to perception, on emulated devices behind pseudo-terminals: the commands are those of a bench,
# where its own rig.toml stands in place of the emulator's. Needs `solidtouch` on the path and takes about a minute.
#   rig-demo.sh [PLAN] [FOLDER]   default: demo-plan.toml beside this script, and a new folder that is removed at the end
set -eu
here=$(cd "$(dirname "$0")" && pwd)
plan=$(realpath "${1:-$here/demo-plan.toml}")
folder=${2:-$(mktemp -d)}
keep=${2:-}
emulator=

finish() {
    if [ -n "$emulator" ]; then
        kill "$emulator" 2>/dev/null || true
        wait "$emulator" || true
        emulator=
    fi
}

trap 'finish; [ -n "$keep" ] || rm -rf "$folder"' EXIT
cd "$folder"

say() {
    printf '\n$'
    printf ' %q' "$@"
    echo
    "$@"
}

emulate() { # devices for one session, in the folder bench-SESSION
    printf '\n$ solidtouch emulate --out bench-%s --seed 4 --session %s &\n' "$1" "$1"
    solidtouch emulate --out "bench-$1" --seed 4 --session "$1" >"emulate-$1.log" 2>&1 &
    emulator=$!
    until [ -S "bench-$1/control" ]; do
        kill -0 "$emulator"
        sleep 0.1
    done
}

for session in 0 1; do
    emulate $session
    [ $session = 1 ] || say solidtouch rig check bench-0/rig.toml --home
    say solidtouch collect "bench-$session/rig.toml" "$plan" --out "session-$session.mcap" --session $session --home
    finish
done

say solidtouch fit session-0.mcap session-1.mcap --out model.nc
say solidtouch crosscheck session-0.mcap session-1.mcap --episodes 3

emulate 1
say solidtouch perceive model.nc --rig bench-1/rig.toml --shadow --home --object "10 mm rod" --start 2.3mm
say solidtouch perceive model.nc --rig replay:session-1.mcap --shadow --object "10 mm rod" --start 2.3mm
say solidtouch perceive model.nc --rig bench-1/rig.toml --object "6 mm rod" --start 4.3mm --deadline 4 --picture live-perception.svg
