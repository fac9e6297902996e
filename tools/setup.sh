#!/bin/sh
# Sets a fresh machine up: a Python, the virtual environment .venv with the packages, a Vulkan driver.
# `make` runs it when it has to: `setup.sh demo` with the packages of the demonstration, `setup.sh test` with those of the tests.
# PYTHON=/path/to/python chooses the interpreter.
set -eu
cd "$(dirname "$0")/.."

EXTRA=${1:-test}
VERSIONS="3.13 3.12 3.11 3.10"

say() { echo "setup: $*" >&2; }

# A Python that is new enough, not newer than what is tested, and can make environments.
works() {
    "$1" -c 'import sys, venv, ensurepip, ctypes, zlib, ssl
sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' >/dev/null 2>&1
}

# The newest interpreter that works, looked for on the path and among those of pyenv.
find_python() {
    for version in $VERSIONS; do
        for candidate in "python$version" "${HOME:-}"/.pyenv/versions/"$version"*/bin/python; do
            if works "$candidate"; then
                echo "$candidate"
                return
            fi
        done
    done
    for candidate in python3 python /usr/bin/python3; do
        if works "$candidate"; then
            echo "$candidate"
            return
        fi
    done
}

install_python() {
    command="apt-get update && apt-get install -y python3 python3-venv"
    if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
        say "no Python 3.10 to 3.13 with venv is here; installing the system's"
        DEBIAN_FRONTEND=noninteractive sh -c "$command" >/dev/null || true
    else
        say "no Python 3.10 to 3.13 with venv is here; install one, on Debian or Ubuntu with: sudo sh -c '$command'"
    fi
}

# Keep an environment that works; make one otherwise.
if ! works .venv/bin/python; then
    python=${PYTHON:-$(find_python)}
    if [ -z "$python" ]; then
        install_python
        python=$(find_python)
    fi
    if [ -z "$python" ] || ! works "$python"; then
        say "stopped: ElVis needs Python 3.10 to 3.13 with its venv module; name one with: make PYTHON=/path/to/python"
        exit 1
    fi
    say "making .venv with $("$python" --version)"
    rm -rf .venv
    "$python" -m venv .venv
fi

# Python compiles modules as it needs them: most of what is installed never runs here.
say "installing the Python packages of the $EXTRA into .venv, once"
if ! .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --editable ".[$EXTRA]"; then
    say "stopped: pip could not install the packages (its reason is above); is there a network? then run make again"
    exit 1
fi

# editors that check types see one package
.venv/bin/python tools/checkout_package.py .venv/package

sh tools/vulkan.sh
