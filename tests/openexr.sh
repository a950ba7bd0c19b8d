#!/bin/sh
# Makes sure that OpenEXR's C library (OpenEXRCore, version 3.1 or newer) and pkg-config are there:
# installs them if a package manager is at hand and allowed to, else says what to install.
found() {
    command -v pkg-config > /dev/null 2>&1 && pkg-config --atleast-version=3.1 OpenEXR
}
as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"
    elif command -v sudo > /dev/null 2>&1; then sudo -n "$@"
    else return 1
    fi
}
found && exit 0
echo "OpenEXR's C library is missing, trying to install it"
if command -v apt-get > /dev/null 2>&1; then
    as_root apt-get update -qq && as_root apt-get install -y -qq libopenexr-dev pkg-config
elif command -v dnf > /dev/null 2>&1; then as_root dnf install -y openexr-devel pkgconf
elif command -v pacman > /dev/null 2>&1; then as_root pacman -S --noconfirm openexr pkgconf
elif command -v apk > /dev/null 2>&1; then as_root apk add openexr-dev pkgconf
elif command -v brew > /dev/null 2>&1; then brew install openexr pkg-config
fi > /dev/null 2>&1
found && exit 0
echo "please install OpenEXR 3.1 or newer with its headers, and pkg-config:" >&2
echo "  Debian, Ubuntu: libopenexr-dev pkg-config    Fedora: openexr-devel pkgconf" >&2
echo "  Arch: openexr pkgconf    Alpine: openexr-dev pkgconf    macOS: brew install openexr pkg-config" >&2
exit 1
