#!/bin/sh
# Brings what tests need beside Python: a Chromium, best without windows, and spirv-val; those that the machine has, else
# the system's packages.
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

# Installs a package of the system, or fails; only root can.
install() {
    apt-get update -o Acquire::http::Timeout=20 >"$LOG" 2>&1 &&
        DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$1" >>"$LOG" 2>&1
}

# Installs a package for the tests, or the next of those named, or tells that tests are skipped without.
bring() {
    command="apt-get update && apt-get install -y --no-install-recommends $1"
    if ! command -v apt-get >/dev/null; then
        say "not here: $1; its tests are skipped"
    elif [ "$(id -u)" -ne 0 ]; then
        say "not here: $1; only root can install it, its tests are skipped without:"
        echo "    sudo sh -c \"$command\"" >&2
    else
        for package in "$@"; do
            say "installing $package for the tests"
            install "$package" && return
        done
        say "$1 could not be installed, its tests are skipped: $(grep '^E:' "$LOG" | head -n 1)"
    fi
}

# A browser without windows takes a third of the time of one with, for a page; older systems have no package of it.
if ! have chromium-headless-shell; then
    if ! have chromium chromium-browser google-chrome; then
        bring chromium-headless-shell chromium
    elif [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
        install chromium-headless-shell
    fi
fi
have spirv-val || bring spirv-tools
exit 0
