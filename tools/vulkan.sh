#!/bin/sh
# Brings a Vulkan driver that works: the one the machine has, else Mesa's software driver from the system's packages.
# Never fails: without a driver ElVis goes on with slang's `cpu` device, slower but with the same numbers.
set -u
cd "$(dirname "$0")/.."

LIBRARIES="libvulkan1 libx11-6 libatomic1"
LOG=.venv/vulkan.log

say() { echo "setup: $*" >&2; }

# Prints the name of the Vulkan device, or fails.
device() {
    .venv/bin/python -c 'import slangpy
print(slangpy.Device(type=slangpy.DeviceType.vulkan).info.adapter_name)' 2>>"$LOG"
}

# The archive that the machine takes its Debian release from.
mirror() {
    apt-get indextargets --format '$(RELEASE) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
        sed -n "s/^$1 //p" | head -n 1
}

# The commands that install the driver here, as text: root runs them, anyone else reads them.
commands() {
    suite=
    if [ "$(. "${OS_RELEASE:-/etc/os-release}" && echo "${VERSION_CODENAME:-}")" = bookworm ]; then
        # Mesa 22.3 of Debian 12 lacks an extension that slang needs; the release's backports have a newer one
        suite="-t bookworm-backports "
        if [ -z "$(mirror bookworm-backports)" ]; then
            printf '%s' "echo 'deb $(mirror bookworm) bookworm-backports main' >/etc/apt/sources.list.d/bookworm-backports.list && "
        fi
    fi
    echo "apt-get update && apt-get install -y --no-install-recommends ${suite}mesa-vulkan-drivers $LIBRARIES"
}

: >"$LOG"
if name=$(device); then
    say "Vulkan device: $name"
    exit 0
fi

# Install the driver, or say how.
if ! command -v apt-get >/dev/null; then
    say "no Vulkan driver works here; install a Vulkan loader, Mesa's Vulkan drivers 23 or later, libX11 and libatomic, then: make setup"
elif [ "$(id -u)" -ne 0 ]; then
    say "no Vulkan driver works here and only root can install one; run this, then make setup:"
    echo "    sudo sh -c \"$(commands)\"" >&2
else
    say "installing Mesa's software Vulkan driver"
    if ! DEBIAN_FRONTEND=noninteractive sh -c "$(commands)" >>"$LOG" 2>&1; then
        say "the system packages could not be installed (no network, or another apt at work?): $(grep '^E:' "$LOG" | head -n 1)"
        say "to try again: make setup; what was said in full is in $LOG"
    fi
fi

if name=$(device); then
    say "Vulkan device: $name"
elif reason=$(.venv/bin/python -c 'import slangpy' 2>&1); then
    say "going on without Vulkan, on slang's cpu device"
else
    say "going on, but nothing can draw: slangpy needs $LIBRARIES ($(echo "$reason" | tail -n 1))"
fi
