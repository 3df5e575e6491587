#!/usr/bin/env bash
# python-can 4.6.1: what a log keeps of a message's channel depends on its format.
#
# One message of channel 2 is written by each writer and read by the reader of the same format. candump's .log
# makes it the name can2; .asc and .blf keep the number; .csv and .db drop it without a word, so two buses
# recorded into one file cannot be told apart. A .asc of another tool (channels from 1) is read from 0 on, a
# .trc as it is written: the same wire has two numbers.
#
# Seen: asc 2, blf 2, log 'can2', csv None, db None; a line of channel 1: asc 0, trc 1
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
with open("tool.asc", "w") as file:
    file.write("date Mon Jan 5 10:00:00.000 am 2026\nbase hex  timestamps absolute\ninternal events logged\n")
    file.write("Begin Triggerblock Mon Jan 5 10:00:00.000 am 2026\n   0.000000 Start of measurement\n")
    file.write("   0.010000 1  123             Rx   d 2 01 02\nEnd TriggerBlock\n")
with open("tool.trc", "w") as file:
    file.write(";$FILEVERSION=2.1\n;$STARTTIME=46027.4166666667\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n")
    file.write("      1        10.000 DT 1      0123 Rx -  2    01 02\n")
asc, trc = (next(iter(can.LogReader(f"tool.{kind}"))).channel for kind in ("asc", "trc"))
print(f"a line of channel 1: asc {asc!r}, trc {trc!r}")
assert found == {"asc": 2, "blf": 2, "log": "can2", "csv": None, "db": None}, found
assert (asc, trc) == (0, 1), (asc, trc)
PYTHON
