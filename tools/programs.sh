#!/bin/sh
# Brings what tests need beside Python: a Chromium, and spirv-val; those that the machine has, else the system's packages.
# Never fails: without them their tests are skipped and say so.
set -u
cd "$(dirname "$0")/.."

LOG=.venv/programs.log

say() { echo "setup: $*" >&2; }

# Whether one of some programs is here.
have() {
    for name in "$@"; do
        command -v "$name" >/dev/null && return
    done
    return 1
}

missing=
have chromium chromium-browser google-chrome || missing="chromium"
have spirv-val || missing="$missing${missing:+ }spirv-tools"
[ -n "$missing" ] || exit 0

install="apt-get update && apt-get install -y --no-install-recommends $missing"
if ! command -v apt-get >/dev/null; then
    say "not here: $missing; their tests are skipped"
elif [ "$(id -u)" -ne 0 ]; then
    say "not here: $missing; only root can install them, their tests are skipped without:"
    echo "    sudo sh -c \"$install\"" >&2
else
    say "installing $missing for the tests"
    if ! DEBIAN_FRONTEND=noninteractive sh -c "$install" >"$LOG" 2>&1; then
        say "$missing could not be installed, their tests are skipped: $(grep '^E:' "$LOG" | head -n 1)"
    fi
fi
