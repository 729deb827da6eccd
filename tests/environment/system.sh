#!/bin/sh
# The system's share of the environment of all backends: DOLFINx for the system's own Python, and a fast BLAS
# under PETSc. Does nothing where both are there; else installs Debian's packages. Says in one line what is wrong.
#
#     sh tests/environment/system.sh [/usr/bin/python3]
set -u

PYTHON=${1:-/usr/bin/python3}
PACKAGES="python3-dolfinx python3-venv libopenblas0-pthread"
WITHOUT="the tests run without DOLFINx and MFEM by: make test REQUIRE=skfem"

fail() {
    echo "$1; $WITHOUT" >&2
    exit 1
}

# Empty if the system has all that is needed, else what is wrong. -I: only the system's own packages count.
lacking() {
    [ -x "$PYTHON" ] || { echo "there is no $PYTHON"; return; }
    # MPI ends the process by itself if it cannot start, so that no exception tells of it.
    answer=$("$PYTHON" -I -c "$PROBE" 2>&1) || {
        echo "$PYTHON ended while it imported DOLFINx ($(printf '%s\n' "$answer" | grep . | tail -n 1))"
        return
    }
    case $answer in *"lacking: "*) echo "${answer##*lacking: }" ;; esac
}

PROBE='
import importlib, sys

def lacking():
    if sys.version_info < (3, 11):
        version = "%d.%d" % sys.version_info[:2]
        return "%s is Python %s, dacore needs 3.11 or newer: Debian 12, Ubuntu 24.04 or later" % (sys.executable, version)
    for name in ("ensurepip", "venv", "numpy", "petsc4py.PETSc", "dolfinx"):
        try:
            importlib.import_module(name)
        except BaseException as error:
            reason = " ".join(str(error).split())
            return "%s cannot import %s (%s: %s)" % (sys.executable, name, type(error).__name__, reason)
    with open("/proc/self/maps") as stream:
        loaded = stream.read()
    # The default libblas3 of Debian is the reference BLAS: ten times slower in direct solves.
    if not any(name in loaded for name in ("openblas", "mkl", "blis")):
        return "PETSc sits on the reference BLAS"

reason = lacking()
if reason:
    print("lacking:", reason)
'

missing=$(lacking)
[ -n "$missing" ] || exit 0
case $missing in *"dacore needs"*) fail "$missing" ;; esac

command -v apt-get >/dev/null 2>&1 ||
    fail "$missing, and there is no apt-get to install it; wanted are Debian's packages $PACKAGES, or their like"

sudo=
if [ "$(id -u)" -ne 0 ]; then
    # Without a terminal nobody can type a password.
    if command -v sudo >/dev/null 2>&1 && { [ -t 0 ] || sudo -n true 2>/dev/null; }; then
        sudo=sudo
    else
        fail "$missing, and only root can install it: ask for apt-get install --no-install-recommends $PACKAGES"
    fi
fi

log=$(mktemp) || exit 1
trap 'rm -f "$log"' EXIT
# shellcheck disable=SC2086  # a list of packages, and sudo or nothing
apt() {
    $sudo env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300 "$@" >"$log" 2>&1 </dev/null
}
echo "Installing $PACKAGES (up to 800 MB, a few minutes): $missing"
# A foreign repository that is out of reach fails the update, not necessarily the packages.
apt update || echo "apt-get update: $(grep -m1 '^[EW]:' "$log" || tail -n 1 "$log")" >&2
# shellcheck disable=SC2086
apt install --no-install-recommends $PACKAGES || {
    tail -n 20 "$log" >&2
    fail "apt-get could not install $PACKAGES"
}
missing=$(lacking)
[ -z "$missing" ] || fail "$PACKAGES are installed, but $missing"
