#!/bin/sh
# Brings a Chromium for the tests of reports: the one the machine has, else that of the system's packages.
# Never fails: without a browser these tests are skipped and say so.
set -u
cd "$(dirname "$0")/.."

LOG=.venv/browser.log

say() { echo "setup: $*" >&2; }

for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null; then
        exit 0
    fi
done

install="apt-get update && apt-get install -y --no-install-recommends chromium"
if ! command -v apt-get >/dev/null; then
    say "no Chromium is here; the tests of reports in a browser are skipped"
elif [ "$(id -u)" -ne 0 ]; then
    say "no Chromium is here and only root can install one; the tests of reports in a browser are skipped without:"
    echo "    sudo sh -c \"$install\"" >&2
else
    say "installing Chromium for the tests of reports"
    if ! DEBIAN_FRONTEND=noninteractive sh -c "$install" >"$LOG" 2>&1; then
        say "Chromium could not be installed, its tests are skipped: $(grep '^E:' "$LOG" | head -n 1)"
    fi
fi
