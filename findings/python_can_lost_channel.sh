#!/usr/bin/env bash
# python-can 4.6.1: the loggers of .csv and .db drop the channel of a message, without a word.
#
# One message of channel 2 is written by each writer and read by the reader of the same format. .asc and .blf keep
# the number, candump's .log makes it the name can2; two buses that were recorded into one .csv or .db cannot be
# told apart.
#
# Seen: asc 2, blf 2, log 'can2', csv None, db None
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check python-can==4.6.1
venv/bin/python - <<'PYTHON'
import can

found = {}
for kind in ("asc", "blf", "log", "csv", "db"):
    with can.Logger(f"one.{kind}") as log:
        log(can.Message(arbitration_id=0x123, data=b"\1\2", channel=2, timestamp=1.0, is_extended_id=False))
    reader = can.LogReader(f"one.{kind}")
    found[kind] = next(iter(reader)).channel
    reader.stop()
print(", ".join(f"{kind} {channel!r}" for kind, channel in found.items()))
assert found == {"asc": 2, "blf": 2, "log": "can2", "csv": None, "db": None}, found
PYTHON
