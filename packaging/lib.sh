# Shared by the scripts of this folder: installs what is missing on a Debian or Ubuntu machine, and says what it does.
# shellcheck shell=bash

say() { printf '\033[1m==> %s\033[0m\n' "$*"; }

die() {
    printf 'error: %s\n' "$1" >&2
    [ $# -gt 1 ] && printf 'hint: %s\n' "$2" >&2
    exit 1
}

# need_packages NAME…: installs the Debian packages that are not there yet.
need_packages() {
    local missing=()
    for package in "$@"; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    say "installing ${missing[*]}"
    command -v apt-get >/dev/null || die "this is no Debian or Ubuntu machine" "install by hand: ${missing[*]}"
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || die "cannot install packages without root" "as root: apt-get install ${missing[*]}"
        root=(sudo)
    fi
    "${root[@]}" apt-get update -qq
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# need_rust: a Rust toolchain is the one thing that a newcomer brings.
need_rust() {
    [ -d "$HOME/.cargo/bin" ] && PATH="$HOME/.cargo/bin:$PATH"
    command -v cargo >/dev/null || die "there is no Rust toolchain" "see https://rustup.rs, then run this again"
}

# need_vulkan: the loader, and a software driver where the machine has no other.
need_vulkan() {
    need_packages libvulkan1
    local drivers
    drivers=$(find /usr/share/vulkan/icd.d /etc/vulkan/icd.d -name '*.json' 2>/dev/null | head -n 1)
    if [ -z "$drivers" ]; then
        say "no Vulkan driver here: Mesa's software driver will do"
        need_packages mesa-vulkan-drivers
    fi
}

# need_compilers: a linker for Rust, and the GLSL compiler that the shaders are built with.
need_compilers() {
    command -v cc >/dev/null || need_packages gcc libc6-dev
    need_packages glslang-tools
}
