# Shared by the scripts of this folder: finds or installs what they need on a Debian or Ubuntu machine, and says what it does.
# shellcheck shell=bash

say() { printf '\033[1m==> %s\033[0m\n' "$*"; }

die() {
    printf 'error: %s\n' "$1" >&2
    [ $# -gt 1 ] && printf 'hint: %s\n' "$2" >&2
    exit 1
}

# need_packages NAME…: installs the Debian packages that are not there yet.
need_packages() {
    local missing=() root=() package
    for package in "$@"; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    command -v apt-get >/dev/null ||
        die "this is no Debian or Ubuntu machine" "install by hand what these packages hold, and run this again: ${missing[*]}"
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || die "cannot install packages without root" "as root: apt-get install ${missing[*]}"
        root=(sudo)
    fi
    say "installing ${missing[*]}${root:+ (sudo may ask for your password)}"

    # A list that is out of date, or a mirror that does not answer, matters only if the packages cannot be had without.
    "${root[@]}" apt-get update -qq || say "the package lists could not be brought up to date; trying with those that are here"
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
        -o DPkg::Lock::Timeout=300 "${missing[@]}" >/dev/null ||
        die "cannot install ${missing[*]}" "see the message above; then run this again"
}

# need_rust [MANIFEST]: a Rust toolchain is the one thing that a newcomer brings; as late a one as the manifest says.
need_rust() {
    local bin=${CARGO_HOME:-${HOME:-/root}/.cargo}/bin wanted found
    [ -d "$bin" ] && PATH="$bin:$PATH"
    { command -v cargo && command -v rustc; } >/dev/null ||
        die "there is no Rust toolchain" "see https://rustup.rs, then run this again"
    wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' "${1:-Cargo.toml}")
    found=$(rustc --version | cut -d ' ' -f 2)
    [ "$(printf '%s\n' "$wanted" "${found%%-*}" | sort -V | head -n 1)" = "$wanted" ] ||
        die "this Rust is $found, and $wanted or later is needed" "rustup update, or see https://rustup.rs"
}

# need_cargo COMMAND…: commands of cargo that a minimal toolchain lacks.
need_cargo() {
    local command
    for command in "$@"; do
        cargo "$command" --version >/dev/null 2>&1 ||
            die "this Rust toolchain has no cargo $command" "rustup component add ${command/fmt/rustfmt}"
    done
}

# need_compilers: a linker for Rust, and the GLSL compiler that the shaders are built with.
need_compilers() {
    command -v cc >/dev/null || need_packages gcc libc6-dev
    command -v glslangValidator >/dev/null || need_packages glslang-tools
}

# has_device LANTERND: whether it finds a Vulkan device that serves.
has_device() {
    local devices
    devices=$("$1" devices --json 2>/dev/null) && [[ $devices == *'"usable": true'* ]]
}

# need_vulkan LANTERND: the loader; and Mesa's software driver, where the machine has no device that serves.
need_vulkan() {
    has_device "$1" && return
    need_packages libvulkan1
    has_device "$1" && return
    say "no Vulkan device here: Mesa's software driver will do"
    need_packages mesa-vulkan-drivers
    has_device "$1" || die "there is still no Vulkan device" "$1 devices says what there is and what it lacks"
}
