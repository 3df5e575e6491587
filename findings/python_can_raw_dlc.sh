#!/usr/bin/env bash
# python-can 4.6.1: one candump line with a raw length code (`_B`) ends the reader of a .log.
#
# On a classic bus a length code of 9 to 15 means 8 bytes; candump -L writes it behind the data (`..._B`), where
# a controller reports it (CAN_CTRLMODE_CC_LEN8_DLC). CanutilsLogReader takes it for data: the line raises
# ValueError, the generator has ended, and all frames behind it are lost, also to a caller that goes on.
#
# Seen: read 1 of 3 frames, then ValueError: invalid literal for int() with base 16: '_B'
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check python-can==4.6.1
cat > candump.log <<'LOG'
(1700000000.000000) can0 123#1122334455667788
(1700000000.001000) can0 123#1122334455667788_B
(1700000000.002000) can0 123#1122334455667788
LOG
venv/bin/python - <<'PYTHON'
import can

frames, error, reader = [], None, iter(can.LogReader("candump.log"))
for _ in range(3):
    try:
        frames.append(next(reader))
    except (ValueError, StopIteration) as raised:
        error = error or raised
print(f"read {len(frames)} of 3 frames, then {type(error).__name__}: {error}")
assert len(frames) == 1 and isinstance(error, ValueError)
PYTHON
