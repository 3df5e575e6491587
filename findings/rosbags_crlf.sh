#!/usr/bin/env bash
# rosbags 0.11.9: a message definition whose lines end with CR LF is not parsed.
#
# Packages that were built from a checkout on Windows put such definitions into the bags of MCAP, and rosbag2 and
# Foxglove read them; rosbags refuses the whole bag for one topic.
#
# Seen: LF 2 fields; CR LF TypesysError
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check rosbags==0.11.9
venv/bin/python - <<'PYTHON'
from rosbags.typesys import get_types_from_msg

definition = "# of a load cell\nfloat64 force\nuint32 sequence\n"
fields = get_types_from_msg(definition, "hand_msgs/msg/Force")["hand_msgs/msg/Force"][1]
try:
    get_types_from_msg(definition.replace("\n", "\r\n"), "hand_msgs/msg/Force")
    windows = "parsed"
except Exception as error:
    windows = type(error).__name__
print(f"LF {len(fields)} fields; CR LF {windows}")
assert (len(fields), windows) == (2, "TypesysError")
PYTHON
