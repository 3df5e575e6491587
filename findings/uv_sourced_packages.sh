#!/usr/bin/env bash
# uv 0.13.9: packages of a sourced ROS 2 do not exist for `uv pip`; what it installs beside them is not what is imported.
#
# A sourced ROS 2 is on PYTHONPATH, and a virtual environment over it is made with --system-site-packages. pip counts
# both as installed. uv looks into neither: it installs a second copy, lists that one and resolves all else against
# it, while Python finds the one of PYTHONPATH first.
#
# Seen: pip 25.3: python-can 4.3.1 is listed and imported; uv: 4.6.1 is listed, 4.3.1 imported
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
unset PYTHONPATH
python3 -m venv --system-site-packages venv
install=(venv/bin/python -m pip install --quiet --disable-pip-version-check)
"${install[@]}" --ignore-installed pip==25.3 uv==0.13.9
"${install[@]}" --target ros python-can==4.3.1
export PYTHONPATH=$folder/ros # as `. /opt/ros/DISTRO/setup.bash` sets it

seen() {
    local listed imported
    listed=$("${@:2}" --format json | python3 -c '
import json, sys
print(*(each["version"] for each in json.load(sys.stdin) if each["name"] == "python-can"))')
    imported=$(venv/bin/python -c 'import can; print(can.__version__)')
    echo "$1: python-can $listed is listed, $imported imported"
}

"${install[@]}" 'python-can>=4,<=4.6.1'
pip=$(seen 'pip 25.3' venv/bin/python -m pip list)
venv/bin/uv pip install --quiet --system-certs --python venv/bin/python 'python-can>=4,<=4.6.1'
uv=$(seen 'uv 0.13.9' venv/bin/uv pip list --quiet --python venv/bin/python)
echo "$pip"
echo "$uv"
[[ $pip == 'pip 25.3: python-can 4.3.1 is listed, 4.3.1 imported' ]]
[[ $uv == 'uv 0.13.9: python-can 4.6.1 is listed, 4.3.1 imported' ]]
