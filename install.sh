#!/usr/bin/env bash
# Installs the system libraries that Blender and open3d load, and the Python packages into a virtual environment.
set -euo pipefail
PYTHON=${PYTHON:-python3.11}
VENV=${VENV:-.venv}
LIBRARIES=(libusb-1.0-0 libgl1 libegl1 libgomp1 libsm6 libice6 libx11-6 libxi6 libxrender1 libxxf86vm1 libxfixes3
    libxkbcommon0)

if command -v dpkg-query >/dev/null; then
    missing=()
    for library in "${LIBRARIES[@]}"; do
        dpkg-query -W -f '${Status}' "$library" 2>/dev/null | grep -q 'ok installed' || missing+=("$library")
    done
    if ((${#missing[@]})); then
        if ((EUID == 0)); then
            apt-get update -qq
            DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
        else
            echo "These system libraries are missing; Blender or open3d will not load without them." >&2
            echo "Ask an administrator to run: apt-get install ${missing[*]}" >&2
        fi
    fi
fi

if ! command -v "$PYTHON" >/dev/null; then
    echo "Python 3.11 is needed (Blender's module exists for that version only); set PYTHON to its path." >&2
    exit 2
fi
[ -x "$VENV/bin/python" ] || "$PYTHON" -m venv "$VENV"
# torch through pip: other installers fetch gigabytes of CUDA.
"$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
